"""The eyes on images that show nothing, rubbish, or half of what they should."""

from __future__ import annotations

import math
from contextlib import closing

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.sim.layout import VIEWS, draw_layout
from hw.sim.operator.belief_state import TO_BLOCK
from hw.sim.world.scene_renderer import SceneRenderer
from hw.sim.world.world import World
from tams_app.records import Vector
from tests.further import further
from tests.hw.sim.operator.scripted_pick import READY
from tests.hw.sim.operator.seeing_rig import Eyes

pytestmark = pytest.mark.untimed

SHAPE = (480, 640, 3)
THE_THINGS_COLOURS = ((40, 120, 240), (60, 200, 60), (200, 90, 30))  # BGR, near enough


@pytest.fixture(scope="module")
def clear():
    layout = draw_layout(5)
    world = World(layout, READY)
    with closing(SceneRenderer(layout)) as renderer:
        return {view: renderer.render(view, world.qpos).copy() for view in VIEWS}


def gap_of(eyes: Eyes) -> Vector:
    """From tool to block [m], as believed."""
    return eyes.seeing.belief.block - eyes.seeing.belief.tcp


def sigma_of(eyes: Eyes) -> float:
    """Of the distance to the block [m]."""
    return eyes.seeing.belief.gap_sigma(TO_BLOCK)


def check_sane(eyes: Eyes) -> None:
    estimate = eyes.seeing.belief.estimate
    assert np.isfinite(estimate.state).all()
    assert np.linalg.eigvalsh(estimate.covariance).min() > -1e-9
    percept = eyes.seeing.look(eyes.now_ns)
    assert percept is None or math.isfinite(percept.gaps.block)


def _alike(level):
    return dict.fromkeys(VIEWS, np.full(SHAPE, level, np.uint8))


def _noise(glance):
    random = np.random.default_rng(glance)
    return {view: random.integers(0, 256, SHAPE, np.uint8) for view in VIEWS}


def _rectangles(seed, count=40):
    """Patches in the colours of the things, anywhere."""
    random = np.random.default_rng([seed, 7])
    images = {}
    for view in VIEWS:
        image = np.full(SHAPE, 90, np.uint8)
        for _ in range(count):
            left, top, width, height = (int(n) for n in random.integers(0, (600, 440, 60, 60)))
            colour = THE_THINGS_COLOURS[int(random.integers(3))]
            cv2.rectangle(image, (left, top), (left + width, top + height), colour, -1)
        images[view] = image
    return images


@pytest.mark.parametrize(
    "images",
    [_alike(90), *further(_alike(0), _alike(255), _noise)],
    ids=["grey", "black", "white", "noise"],
)
def test_images_of_nothing_make_the_operator_ever_less_sure(clear, images):
    eyes = Eyes()
    eyes.show(clear, 6)
    sigmas = [sigma_of(eyes)]
    for _ in range(2):
        eyes.show(images, 4 if images is _noise else 12)
        check_sane(eyes)
        sigmas.append(sigma_of(eyes))
    assert sigmas == sorted(sigmas)
    assert sigmas[-1] > 1.5 * sigmas[0]


@pytest.mark.parametrize(
    "images", [_rectangles, *further(_alike(90), _noise)], ids=["rectangles", "grey", "noise"]
)
def test_eyes_that_have_seen_nothing_but_rubbish_know_nothing(images):
    eyes = Eyes()
    eyes.show(images, 5)
    check_sane(eyes)
    assert sigma_of(eyes) > 0.01


def _without(image, side):
    height, width = image.shape[:2]
    image = image.copy()
    image[
        {"upper": np.s_[: height // 2], "lower": np.s_[height // 2 :]}.get(side, np.s_[:]),
        {"left": np.s_[: width // 2], "right": np.s_[width // 2 :]}.get(side, np.s_[:]),
    ] = 90
    return image


@pytest.mark.parametrize("side", ["upper", "lower", "left", "right"])
def test_half_an_image_never_makes_the_operator_surer(clear, side):
    whole, half = Eyes(), Eyes()
    whole.show(clear, 10)
    half.show({view: _without(image, side) for view, image in clear.items()}, 10)
    check_sane(half)
    assert sigma_of(half) > 0.95 * sigma_of(whole)


@pytest.mark.parametrize("view", VIEWS)
def test_a_view_that_turns_to_rubbish_does_not_mislead_the_operator(clear, view):
    eyes = Eyes()
    eyes.show(clear, 8)
    before = gap_of(eyes)
    eyes.show(lambda glance: {**clear, view: _rectangles(glance)[view]}, 12)
    check_sane(eyes)
    off = np.linalg.norm((gap_of(eyes) - before)[:2])
    assert off < max(0.003, 3.0 * sigma_of(eyes))


def test_clear_images_after_rubbish_are_believed_again(clear):
    before, eyes = Eyes(), Eyes()
    before.show(clear, 10)
    eyes.show(clear, 5)
    eyes.show(_rectangles, 12)
    eyes.show(clear, 25)
    assert sigma_of(eyes) < 2.0 * sigma_of(before)
    off = gap_of(eyes) - gap_of(before)
    assert np.linalg.norm(off[:2]) < 3.0 * math.hypot(sigma_of(eyes), sigma_of(before))


@pytest.mark.parametrize("pixel", [(12, 291), (4, 225)], ids=["in reach", "out of reach"])
def test_a_block_first_seen_where_there_is_none_is_found_where_it_lies(clear, pixel):
    """So it was live: the table's edge, in the first frames of a stream that builds up."""
    rested, misled = Eyes(), Eyes()
    rested.show(clear, 12)
    misled.show({**clear, "gt": _orange_patch(pixel)}, 1)
    assert np.linalg.norm(gap_of(misled) - gap_of(rested)) > 0.2
    misled.show(clear, 12)
    assert gap_of(misled) == pytest.approx(gap_of(rested), abs=0.001)
    assert sigma_of(misled) < 1.5 * sigma_of(rested)


def _orange_patch(middle):
    left, top = middle[0] - 9, middle[1] - 9
    image = np.full(SHAPE, 130, np.uint8)
    return cv2.rectangle(image, (left, top), (left + 18, top + 18), THE_THINGS_COLOURS[0], -1)


@pytest.mark.verify
@settings(max_examples=6, deadline=None)
@given(seed=st.integers(0, 10_000), size=st.integers(1, 80))
def test_no_image_is_too_strange_to_look_at(seed, size):
    eyes = Eyes()
    for images in (_rectangles(seed, size), _noise(seed)):
        eyes.show(images, 1)
        check_sane(eyes)
