"""`rig.xml` states sizes that operator and controller know from elsewhere; surfaces have detail."""

import cv2
import numpy as np
import pytest

from hw.lite6.kinematics import JOINT_LOWER, JOINT_UPPER
from hw.sim import layout
from hw.sim.operator.vision.views import fixed_cameras
from hw.sim.world import scene
from hw.sim.world.world import JOINTS, STEP_NS

pytestmark = pytest.mark.untimed

LAYOUT = layout.draw_layout(3)
WALL_HALF = layout.CONTAINER_WALL_M / 2
OUTER_HALF = layout.CONTAINER_INNER_M / 2 + layout.CONTAINER_WALL_M


@pytest.fixture(scope="module")
def model():
    return scene.build_model(LAYOUT, textured=True)


@pytest.mark.parametrize(
    ("geom", "half"),
    [
        ("housing", layout.HOUSING[1]),
        ("plate", layout.PLATE[1]),
        ("pad_left", layout.PAD_HALF),
        ("pad_right", layout.PAD_HALF),
        ("clip_left", layout.CLIP_HALF),
        ("clip_right", layout.CLIP_HALF),
        ("marker_ahead", (0.0006, layout.MARKER_HALF_M, layout.MARKER_HALF_M)),
        ("marker_left", (layout.MARKER_HALF_M, 0.0006, layout.MARKER_HALF_M)),
        (
            "block",
            np.array([1, 1, 0]) * layout.BLOCK_EDGE_M / 2 + [0, 0, layout.BLOCK_HEIGHT_M / 2],
        ),
        ("bin_wall", (WALL_HALF, OUTER_HALF, layout.CONTAINER_HEIGHT_M / 2)),
        ("bin_floor", (layout.CONTAINER_INNER_M / 2, layout.CONTAINER_INNER_M / 2, 0.001)),
    ],
)
def test_things_are_as_large_as_the_operator_knows_them(model, geom, half):
    assert model.geom(geom).size == pytest.approx(half)


def test_the_gripper_is_made_as_the_operator_knows_it(model):
    assert model.geom("housing").pos == pytest.approx(layout.HOUSING[0])
    assert model.geom("plate").pos == pytest.approx(layout.PLATE[0])
    assert model.site("tcp").pos[2] == layout.TCP_OFFSET_M
    for finger, side in (("left", -1), ("right", 1)):
        assert model.body(f"finger_{finger}").pos[1] == side * layout.FINGER_TRAVEL_M
        assert model.geom(f"pad_{finger}").pos[1] == side * layout.PAD_HALF[1]
        assert model.joint(f"finger_{finger}").range[1] == layout.FINGER_TRAVEL_M + 0.0001


def test_joint_ranges_are_the_controllers(model):
    ranges = np.array([model.joint(name).range for name in JOINTS])
    assert (ranges == np.column_stack((JOINT_LOWER, JOINT_UPPER))).all()


def test_a_step_is_as_long_as_the_world_counts_it(model):
    assert model.opt.timestep == STEP_NS / 1e9


def test_fixed_cameras_look_as_the_operator_believes(model):
    for view, camera in fixed_cameras().items():
        seen = model.camera(view)
        assert seen.pos == pytest.approx(camera.place)
        axes = seen.mat0.reshape(3, 3) * [1, -1, -1]  # MuJoCo's: right, up, backward
        assert axes == pytest.approx(camera.axes, abs=1e-5)


@pytest.mark.parametrize(
    "paint", [scene.wood, scene.brick, scene.concrete, scene.brushed, scene.card,
              scene.label],
)  # fmt: skip
def test_surfaces_repeat_with_their_seed_and_have_detail(paint):
    first, second, other = (paint(np.random.default_rng(seed), 256, 128) for seed in (1, 1, 2))
    assert first.shape == (256, 128, 3)
    assert first.dtype == np.uint8
    assert np.array_equal(first, second)
    assert not np.array_equal(first, other)
    assert first.std() > 5


def test_mat_has_its_four_markers_and_the_size_that_was_asked_for():
    mat = scene.work_mat(np.random.default_rng(0), 512, 1024, (0.46, 0.68))
    assert mat.shape == (512, 1024, 3)
    square = cv2.resize(mat, (1024, round(1024 * 0.46 / 0.68)))
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
    _, identities, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(square)
    assert sorted(identities.ravel().tolist()) == [10, 11, 12, 13]
