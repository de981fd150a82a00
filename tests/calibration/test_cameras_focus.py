"""Sharpness that depends on the lens alone, and what is said of light and time."""

import cv2
import numpy as np
import pytest

from calibration.cameras.image_quality import (
    Exposure,
    exposure_advice,
    focus_advice,
    measure_exposure,
    sharpness,
    smear_px,
)

pytestmark = pytest.mark.untimed


def edges(seed=0):
    random = np.random.default_rng(seed)
    grey = np.zeros((480, 640), np.float32)
    for _ in range(40):
        x, y, w, h = random.integers((0, 0, 20, 20), (600, 440, 120, 120))
        grey[y : y + h, x : x + w] = random.integers(0, 255)
    return grey


def image(grey, blur_px=0.0, contrast=1.0, noise=0.0, seed=0):
    if blur_px:
        grey = cv2.GaussianBlur(grey, (0, 0), blur_px)
    grey = contrast * grey + 20
    grey = grey + np.random.default_rng(seed).normal(0, noise, grey.shape)
    return cv2.cvtColor(np.clip(grey, 0, 255).astype(np.uint8), cv2.COLOR_GRAY2BGR)


@pytest.mark.parametrize("blur_px", [1.0, 2.0, 3.0])
@pytest.mark.parametrize(("contrast", "noise"), [(0.8, 0.0), (0.8, 3.0), (0.4, 3.0)])
@pytest.mark.parametrize("scene", [0, 1])
def test_blur_is_measured_whatever_scene_light_and_noise(blur_px, contrast, noise, scene):
    measured = sharpness(image(edges(scene), blur_px, contrast, noise))
    assert measured.blur_px == pytest.approx(blur_px, rel=0.2)
    assert measured.noise == pytest.approx(noise, abs=0.4)


def test_turning_the_ring_towards_focus_always_raises_the_bar():
    bars = [sharpness(image(edges(), blur, 0.8, 3.0)).tenengrad for blur in (6, 4, 3, 2, 1, 0.5)]
    assert bars == sorted(bars)


@pytest.mark.parametrize("noise", [0.0, 3.0, 8.0])
def test_a_blank_wall_is_nothing_to_focus_on(noise):
    measured = sharpness(image(np.full((480, 640), 100, np.float32), noise=noise))
    assert not measured.measurable
    assert "nothing to focus on" in focus_advice(measured)


def test_advice_follows_the_blur():
    assert focus_advice(sharpness(image(edges(), 1.0))) == ""
    assert "a little soft" in focus_advice(sharpness(image(edges(), 2.0)))
    assert "out of focus" in focus_advice(sharpness(image(edges(), 4.0)))


def lit(level, count=40, flicker=0.0, beat=3.0):
    rows = np.arange(480)[:, None, None]
    return [
        np.clip(
            level * (1 + flicker * np.sin(2 * np.pi * (rows / 200 + number / beat)))
            + np.random.default_rng(number).normal(0, 2, (480, 640, 3)),
            0,
            255,
        ).astype(np.uint8)
        for number in range(count)
    ]


def test_a_lamp_that_flickers_is_measured_and_named():
    seen = measure_exposure(lit(120, flicker=0.08))
    assert seen.flicker == pytest.approx(0.08, rel=0.15)
    assert any("flickers" in line for line in exposure_advice(seen, None, 30, 640))


def test_steady_light_and_a_slow_cloud_are_no_flicker():
    assert measure_exposure(lit(120)).flicker < 0.005
    assert measure_exposure(lit(120, flicker=0.1, beat=400.0)).flicker < 0.01


def test_a_thing_that_moves_in_a_part_of_the_image_is_no_flicker():
    images = lit(120)
    for number, each in enumerate(images):
        each[100:200, 10 * number : 10 * number + 150] = 250
    assert measure_exposure(images).flicker < 0.01


@pytest.mark.parametrize(("level", "words"), [(250, "too bright"), (20, "too dark"), (120, "")])
def test_light_is_judged_in_words(level, words):
    advice = exposure_advice(measure_exposure(lit(level, count=2)), None, 30, 640)
    assert (words in " ".join(advice)) if words else advice == []


def test_an_exposure_longer_than_a_frame_or_a_smear_is_told():
    good = Exposure(110.0, 0.0, 0.0, None)
    assert exposure_advice(good, 8000, 30, 640) == []
    assert "the rate drops" in exposure_advice(good, 40_000, 30, 640)[0]
    assert "smear over 6 px" in exposure_advice(good, 20_000, 30, 640)[0]
    assert smear_px(10_000, 640) == pytest.approx(3.2)
