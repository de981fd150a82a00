"""Which camera something moved in front of, whatever the light and the noise do."""

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.cameras.binding import MotionMeter, attribute

pytestmark = pytest.mark.untimed

NAMES = ("a", "b", "c")
HEIGHT, WIDTH = 240, 320


class Scene:
    """A camera's images: noise, a flickering lamp in bands, and a hand of some size."""

    def __init__(self, seed, noise=2.0, flicker=0.0):
        self._random = np.random.default_rng(seed)
        small = self._random.integers(40, 180, (8, 10)).astype(np.float32)
        self._still = cv2.resize(small, (WIDTH, HEIGHT), interpolation=cv2.INTER_CUBIC)
        self._noise, self._flicker = noise, flicker
        self._number = 0

    def image(self, hand_px=0):
        self._number += 1
        rows = np.arange(HEIGHT)[:, None]
        phase = 2 * np.pi * (rows / 90 + self._number / 3)
        grey = self._still * (1 + self._flicker * np.sin(phase))
        if hand_px:
            x = int(WIDTH / 2 + 80 * np.sin(self._number / 3))
            y = int(HEIGHT / 2 + 30 * np.cos(self._number / 4))
            cv2.circle(grey, (x, y), hand_px, 200.0, -1)
        grey = grey + self._random.normal(0, self._noise, grey.shape)
        return cv2.cvtColor(np.clip(grey, 0, 255).astype(np.uint8), cv2.COLOR_GRAY2BGR)


def watch(hands, seed=1, noise=2.0, flicker=0.0):
    moved = {}
    for place, name in enumerate(NAMES):
        scene, meter = Scene(seed + place, noise, flicker), MotionMeter()
        for _ in range(10):
            meter.rest(scene.image())
        moved[name] = [meter.moved(scene.image(hands.get(name, 0))) for _ in range(15)]
    return moved


@pytest.mark.verify
@settings(max_examples=8)
@given(
    camera=st.sampled_from(NAMES),
    noise=st.floats(0, 12),
    flicker=st.floats(0, 0.3),
    seed=st.integers(0, 1000),
)
def test_the_camera_that_a_hand_waved_before_is_found_under_noise_and_flicker(
    camera, noise, flicker, seed
):
    found = attribute(watch({camera: 60}, seed, noise, flicker), {})
    assert (found.camera, found.reason) == (camera, "")


@pytest.mark.parametrize(("noise", "flicker"), [(0.0, 0.0), (12.0, 0.0), (2.0, 0.4)])
def test_noise_and_flicker_alone_are_no_motion(noise, flicker):
    found = attribute(watch({}, noise=noise, flicker=flicker), {})
    assert found.camera == ""
    assert "hardly anything moved" in found.reason


def test_a_hand_that_two_cameras_see_is_attributed_to_neither():
    found = attribute(watch({"a": 60, "c": 60}), {})
    assert found.camera == ""
    assert "a and c all saw it" in found.reason or "c and a all saw it" in found.reason


def test_a_hand_far_off_in_another_camera_does_not_confuse():
    assert attribute(watch({"b": 70, "c": 15}), {}).camera == "b"


def test_a_camera_that_has_its_view_already_is_not_taken_again():
    found = attribute(watch({"b": 60}), {"b": "eih"})
    assert found.camera == ""
    assert "EIH already" in found.reason


def test_a_scene_that_never_rests_counts_only_what_is_beyond_it():
    scene, meter = Scene(4), MotionMeter()
    for _ in range(20):
        meter.rest(scene.image(hand_px=50))
    assert np.mean([meter.moved(scene.image(hand_px=50)) for _ in range(20)]) < 0.02


def test_cameras_that_gave_no_images_are_the_reason():
    found = attribute({"a": [], "b": [0.2] * 3}, {})
    assert "no camera gave enough images" in found.reason
