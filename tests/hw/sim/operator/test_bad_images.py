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
from hw.sim.operator.efference import EfferenceCopy
from hw.sim.operator.seeing import OnScreen, SeeingPerception
from hw.sim.operator.task import Stage
from hw.sim.world.scene_renderer import SceneRenderer
from hw.sim.world.world import World
from tams_app.records import Image, Vector
from tams_app.units import NS_PER_MS
from tests.further import further
from tests.hw.sim.operator.scripted_pick import READY

pytestmark = pytest.mark.untimed

SHAPE = (480, 640, 3)
GLANCE_NS = 80 * NS_PER_MS
THE_THINGS_COLOURS = ((40, 120, 240), (60, 200, 60), (200, 90, 30))  # BGR, near enough


@pytest.fixture(scope="module")
def clear():
    layout = draw_layout(5)
    world = World(layout, READY)
    with closing(SceneRenderer(layout)) as renderer:
        return {view: renderer.render(view, world.qpos).copy() for view in VIEWS}


class Eyes:
    """They look at whatever `show` puts before them, the hand at rest."""

    def __init__(self) -> None:
        self.screen: dict[str, Image | None] = {}
        self.now_ns = 0
        self.seeing = SeeingPerception(lambda _: OnScreen(self.screen), EfferenceCopy(), 0.08, 0.12)

    def show(self, images, glances: int) -> None:
        for glance in range(glances):
            self.screen = images(glance) if callable(images) else images
            self.now_ns += GLANCE_NS
            assert self.seeing.watch(self.now_ns, Stage.REACH)

    @property
    def gap(self) -> Vector:
        """From tool to block [m], as believed."""
        return self.seeing.belief.block - self.seeing.belief.tcp

    @property
    def sigma(self) -> float:
        """Of the distance to the block [m]."""
        return self.seeing.belief.gap_sigma(TO_BLOCK)

    def check_sane(self) -> None:
        estimate = self.seeing.belief.estimate
        assert np.isfinite(estimate.state).all()
        assert np.linalg.eigvalsh(estimate.covariance).min() > -1e-9
        percept = self.seeing.look(self.now_ns)
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
    sigmas = [eyes.sigma]
    for _ in range(2):
        eyes.show(images, 4 if images is _noise else 12)
        eyes.check_sane()
        sigmas.append(eyes.sigma)
    assert sigmas == sorted(sigmas)
    assert sigmas[-1] > 1.5 * sigmas[0]


@pytest.mark.parametrize(
    "images", [_rectangles, *further(_alike(90), _noise)], ids=["rectangles", "grey", "noise"]
)
def test_eyes_that_have_seen_nothing_but_rubbish_know_nothing(images):
    eyes = Eyes()
    eyes.show(images, 5)
    eyes.check_sane()
    assert eyes.sigma > 0.01


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
    half.check_sane()
    assert half.sigma > 0.95 * whole.sigma


@pytest.mark.parametrize("view", VIEWS)
def test_a_view_that_turns_to_rubbish_does_not_mislead_the_operator(clear, view):
    eyes = Eyes()
    eyes.show(clear, 8)
    before = eyes.gap
    eyes.show(lambda glance: {**clear, view: _rectangles(glance)[view]}, 12)
    eyes.check_sane()
    off = np.linalg.norm((eyes.gap - before)[:2])
    assert off < max(0.003, 3.0 * eyes.sigma)


def test_clear_images_after_rubbish_are_believed_again(clear):
    before, eyes = Eyes(), Eyes()
    before.show(clear, 10)
    eyes.show(clear, 5)
    eyes.show(_rectangles, 12)
    eyes.show(clear, 25)
    assert eyes.sigma < 2.0 * before.sigma
    off = eyes.gap - before.gap
    assert np.linalg.norm(off[:2]) < 3.0 * math.hypot(eyes.sigma, before.sigma)


@pytest.mark.parametrize("pixel", [(12, 291), (4, 225)], ids=["in reach", "out of reach"])
def test_a_block_first_seen_where_there_is_none_is_found_where_it_lies(clear, pixel):
    """So it was live: the table's edge, in the first frames of a stream that builds up."""
    rested, misled = Eyes(), Eyes()
    rested.show(clear, 12)
    misled.show({**clear, "gt": _orange_patch(pixel)}, 1)
    assert np.linalg.norm(misled.gap - rested.gap) > 0.2
    misled.show(clear, 12)
    assert misled.gap == pytest.approx(rested.gap, abs=0.001)
    assert misled.sigma < 1.5 * rested.sigma


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
        eyes.check_sane()
