from __future__ import annotations

import sys
from collections.abc import Iterator

import cv2
import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hw.lite6.kinematics import JOINT_LOWER, JOINT_UPPER
from hw.sim.layout import (
    CONTAINER_MARKER,
    FINGER_TRAVEL_M,
    GRIPPER_MARKER,
    HEIGHT_PX,
    VIEWS,
    WIDTH_PX,
    draw_layout,
)
from hw.sim.world import scene_renderer
from hw.sim.world.scene_renderer import NOISE_SIGMA, SceneRenderer, SensorNoise
from hw.sim.world.world import World
from tams_app.errors import SetupError
from tams_app.records import Image, Vector
from tests.hw.sim.operator.scripted_pick import ARM, CYCLE_NS, READY

pytestmark = pytest.mark.untimed

LAYOUT = draw_layout(5)


@pytest.fixture(scope="module")
def renderer() -> Iterator[SceneRenderer]:
    renderer = SceneRenderer(LAYOUT)
    yield renderer
    renderer.close()


@pytest.fixture(scope="module")
def ready() -> Vector:
    return World(LAYOUT, READY).qpos


def poses() -> list[Vector]:
    world, target, seen = World(LAYOUT, READY), READY.copy(), []
    for cycle in range(120):
        target = target + np.array([0.004, 0.001, 0.001, 0.002, 0.003, 0.006])
        world.step(target, True, CYCLE_NS)
        if cycle % 30 == 0:
            seen.append(world.qpos)
    return seen


def anywhere() -> list[Vector]:
    """The arm in any pose, also above and below the table, the block in its grip or lying about."""
    random, kinematics, seen = np.random.default_rng(11), ARM, []
    for number in range(12):
        joints = random.uniform(JOINT_LOWER, JOINT_UPPER)
        if number % 2:
            joints = READY + random.normal(0, 0.25, 6)
        fingers = np.full(2, random.uniform(0, FINGER_TRAVEL_M))
        tcp = kinematics.tcp_matrix(joints)
        place = tcp[:3, 3] if number % 3 else random.uniform((0.1, -0.3, 0), (0.6, 0.3, 0.05))
        turn = Rotation.from_matrix(tcp[:3, :3]).as_quat()[[3, 0, 1, 2]]
        seen.append(np.concatenate((joints, fingers, place, turn)))
    return seen


def drawn_whole(renderer: SceneRenderer, view: str, qpos: Vector) -> Image:
    """The image of `view` with everything drawn anew, read as MuJoCo reads it."""
    renderer._pose(qpos)
    renderer._draw(renderer._cameras[view], np.ones(renderer._model.ngeom, bool))
    colour = np.empty((HEIGHT_PX, WIDTH_PX, 3), np.uint8)
    mujoco.mjr_readPixels(colour, None, renderer._whole, renderer._drawing)
    image = cv2.cvtColor(colour, cv2.COLOR_RGB2BGR)
    return cv2.flip(image, 0) if renderer._upside_down else image


def markers(image: Image) -> set[int]:
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    _, identities, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(image)
    return set() if identities is None else {int(identity) for identity in identities.ravel()}


@pytest.mark.parametrize("view", VIEWS)
def test_shortcut_is_pixel_identical_to_drawing_everything(
    renderer: SceneRenderer, view: str
) -> None:
    images = []
    for qpos in (*poses(), *anywhere()):
        images.append(renderer.render(view, qpos))
        assert np.array_equal(images[-1], drawn_whole(renderer, view, qpos))
    assert not np.array_equal(images[0], images[-1])


def test_a_driver_that_reads_the_bottom_row_first_gives_the_same_images(
    renderer: SceneRenderer, ready: Vector, monkeypatch: pytest.MonkeyPatch
) -> None:
    usual = {view: renderer.render(view, ready) for view in VIEWS}
    monkeypatch.setattr(scene_renderer, "_TOP_ROW_FIRST", "GL_NO_SUCH_extension")
    other = SceneRenderer(LAYOUT)
    try:
        assert other._upside_down
        for view, image in usual.items():
            assert np.array_equal(other.render(view, ready), image)
    finally:
        other.close()
        renderer._context.make_current()


def test_markers_of_container_gripper_and_mat_can_be_detected(
    renderer: SceneRenderer, ready: Vector
) -> None:
    assert CONTAINER_MARKER in markers(renderer.render("gt", ready))
    assert {12, 13} <= markers(renderer.render("gt", ready))
    assert GRIPPER_MARKER in markers(renderer.render("gs", ready))


def test_missing_opengl_is_one_sentence_that_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "mujoco.egl", None)
    monkeypatch.setitem(sys.modules, "mujoco.osmesa", None)
    with pytest.raises(SetupError, match="install libegl1"):
        SceneRenderer(LAYOUT)


def grey(value: int = 120) -> Image:
    return np.full((HEIGHT_PX, WIDTH_PX, 3), value, np.uint8)


def test_noise_repeats_for_a_frame_and_differs_between_frames_views_and_seeds() -> None:
    def noisy(seed: int, view: str, index: int) -> Image:
        return SensorNoise(seed, view).apply(grey(), index)

    reference = noisy(1, "gt", 5)
    assert np.array_equal(reference, noisy(1, "gt", 5))
    for other in (noisy(1, "gt", 6), noisy(1, "gs", 5), noisy(2, "gt", 5)):
        assert not np.array_equal(reference, other)


def test_noise_has_its_strength_and_no_bias() -> None:
    noisy = SensorNoise(1, "gt").apply(grey(), 0).astype(float)
    assert noisy.std() == pytest.approx(NOISE_SIGMA, rel=0.1)
    assert noisy.mean() == pytest.approx(120, abs=0.3)


def test_noise_never_wraps_around() -> None:
    assert SensorNoise(1, "gt").apply(grey(255), 0).min() > 200
    assert SensorNoise(1, "gt").apply(grey(0), 0).max() < 55
