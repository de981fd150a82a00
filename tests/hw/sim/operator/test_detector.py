"""On images of the rig's own cameras, sharp and blurred."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import closing
from dataclasses import dataclass

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from hw.sim.layout import VIEWS, Layout, draw_layout
from hw.sim.operator.belief import Belief
from hw.sim.operator.belief_state import BLOCK, BLOCK_YAW, CONTAINER, TOOL
from hw.sim.operator.detector import Detector
from hw.sim.operator.vision.blobs import FingerGauge
from hw.sim.operator.vision.views import Glance, Sighting, Thing, wrist_cameras
from hw.sim.world.scene_renderer import SceneRenderer
from hw.sim.world.world import World
from tams_app.records import Image, SceneTruth, Vector
from tests.hw.sim.operator.scripted_pick import CYCLE_NS, READY

pytestmark = pytest.mark.untimed

LAYOUT = draw_layout(5)
OVER = np.array([-0.33, 0.0, 0.0, 0.0, 0.0, 0.0])  # turns the arm towards the block


@dataclass
class Scene:
    layout: Layout
    renderer: SceneRenderer
    truth: SceneTruth
    qpos: Vector

    def images(self, blur: float = 0.0, qpos: Vector | None = None) -> dict[str, Image]:
        images = {}
        for view in VIEWS:
            image = self.renderer.render(view, self.qpos if qpos is None else qpos)
            images[view] = cv2.GaussianBlur(image, (0, 0), blur) if blur else image
        return images


@pytest.fixture(scope="module")
def scene() -> Iterator[Scene]:
    world, renderer = World(LAYOUT, READY + OVER), SceneRenderer(LAYOUT)
    yield Scene(LAYOUT, renderer, world.truth(0), world.qpos)
    renderer.close()


def _belief(truth: SceneTruth) -> Belief:
    """One who knows where everything is, to a centimetre."""
    belief = Belief()
    belief.state[TOOL] = truth.tcp.position
    belief.state[5] = _yaw(truth)
    belief.state[BLOCK] = truth.block.position
    belief.state[BLOCK_YAW] = LAYOUT.block.yaw
    belief.state[CONTAINER] = truth.container.position[:2]
    belief.covariance[:] = np.diag(
        np.array([0.005] * 3 + [0.01] * 3 + [0.005] * 3 + [0.3, 0.01, 0.01]) ** 2
    )
    belief.seen = dict.fromkeys(Thing, True)
    return belief


def _yaw(truth: SceneTruth) -> float:
    x_axis = truth.tcp.rotation.as_matrix()[:, 0]
    return math.atan2(x_axis[1], x_axis[0])


def _look(scene: Scene, blur: float = 0.0) -> Glance:
    looker = Detector()
    return looker.look(scene.images(blur), _belief(scene.truth))


def _sigma(seen: Sighting) -> float:
    return math.hypot(seen.sigma_px, seen.lasting_px)


def _errors(glance: Glance, truth: SceneTruth) -> list[tuple[str, str, float, float]]:
    """View, thing, distance [px] from where the thing truly shows, and its sigma."""
    belief, errors = _belief(truth), []
    centres = {
        Thing.TOOL: truth.tcp.position,
        Thing.BLOCK: truth.block.position,
        Thing.CONTAINER: truth.container.position,
    }
    for seen in glance.sightings:
        turn = truth.tcp.rotation.as_matrix() if seen.thing is Thing.TOOL else np.eye(3)
        points = centres[seen.thing] + seen.points @ turn.T
        off = (seen.pixels - belief.camera(seen.view).project(points)).mean(axis=0)
        errors.append((seen.view, seen.thing.value, float(np.linalg.norm(off)), _sigma(seen)))
    return errors


def test_every_view_finds_what_it_can_show(scene):
    found = {(seen.view, seen.thing) for seen in _look(scene).sightings}
    assert {(view, Thing.BLOCK) for view in VIEWS} <= found
    assert {("gt", Thing.TOOL), ("gs", Thing.TOOL)} <= found
    assert {("gt", Thing.CONTAINER), ("gs", Thing.CONTAINER)} & found
    assert ("eih", Thing.TOOL) not in found


def test_the_gripper_s_marker_and_its_green_pads_are_both_used(scene):
    counts = {len(seen.pixels) for seen in _look(scene).sightings if seen.view == "gs"}
    assert counts == {1, 4}


@pytest.mark.parametrize("blur", [0.0, 1.5, 3.0])
def test_errors_are_as_large_as_believed_and_about_a_pixel_where_the_image_is_sharp(scene, blur):
    errors = _errors(_look(scene, blur), scene.truth)
    assert len(errors) >= 5
    for view, thing, error, sigma in errors:
        assert error < 4.0 * sigma, (view, thing, error, sigma)
        if not blur:
            assert error < 3.0, (view, thing)
            assert sigma < 2.5, (view, thing)
            assert thing != "block" or max(error, sigma) < 1.0, view


def test_the_block_s_yaw_is_read_in_the_wrist_s_view(scene):
    (heading,) = _look(scene).headings
    true = LAYOUT.block.yaw - _yaw(scene.truth)
    off = (heading.heading - true + math.pi / 4) % (math.pi / 2) - math.pi / 4
    assert abs(math.degrees(off)) < 3.0
    assert not heading.lying


def test_a_block_on_its_side_is_seen_to_lie(scene):
    qpos = scene.qpos.copy()
    qpos[10] = 0.006
    x, y, z, w = (Rotation.from_euler("z", 0.9) * Rotation.from_euler("y", math.pi / 2)).as_quat()
    qpos[11:15] = (w, x, y, z)
    belief = _belief(scene.truth)
    belief.state[BLOCK][2] = 0.006
    looker = Detector()
    (heading,) = looker.look(scene.images(qpos=qpos), belief).headings
    assert heading.lying
    off = heading.heading - (0.9 - _yaw(scene.truth))
    assert abs(math.degrees((off + math.pi / 2) % math.pi - math.pi / 2)) < 6.0


def test_the_block_is_found_anywhere_on_the_mat_at_first(scene):
    belief = Belief()
    looker = Detector()
    belief.state[TOOL] = scene.truth.tcp.position
    for _ in range(2):
        belief.take(looker.look(scene.images(), belief).sightings)
    assert belief.block[:2] == pytest.approx(scene.truth.block.position[:2], abs=0.003)
    assert belief.container[:2] == pytest.approx(scene.truth.container.position[:2], abs=0.003)


@pytest.mark.parametrize("near", [False, True], ids=["far from the fingers", "near them"])
def test_a_block_that_plainly_is_not_there_is_looked_for_elsewhere_unless_in_the_fingers(
    scene, near
):
    belief = _belief(scene.truth)
    belief.seen[Thing.BLOCK] = True
    belief.state[BLOCK] = (0.30, 0.06, 0.01)
    if near:
        belief.state[TOOL] = (0.30, 0.06, 0.03)
    glance = Detector().look(scene.images(), belief)
    found = {seen.view for seen in glance.sightings if seen.thing is Thing.BLOCK}
    assert found == (set() if near else {"gt", "gs"})


def test_a_container_whose_marker_cannot_be_read_is_found_by_its_blue(scene):
    belief = Belief()
    looker = Detector()
    for _ in range(3):
        belief.take(looker.look(scene.images(blur=6.0), belief).sightings)
    assert belief.seen[Thing.CONTAINER]
    assert belief.container[:2] == pytest.approx(scene.truth.container.position[:2], abs=0.02)


def test_the_fingers_opening_is_read_off_the_pads():
    world = World(LAYOUT, READY)
    with closing(SceneRenderer(LAYOUT)) as renderer:
        gauge, pairs = FingerGauge(wrist_cameras()["eih"]), []
        for _ in range(20):
            pairs.append((gauge.measure(renderer.render("eih", world.qpos)), world.truth(0)))
            world.step(READY, True, 8 * CYCLE_NS)
    read = [(seen, truth.fingers_opening) for seen, truth in pairs if seen is not None]
    assert len(read) > 10
    assert all(abs(seen - true) < 0.002 for seen, true in read)
    assert read[0][0] > 0.015
    assert read[-1][0] < 0.003
    assert gauge.measure(np.full((480, 640, 3), 90, np.uint8)) is None
