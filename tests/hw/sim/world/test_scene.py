"""`rig.xml` states sizes that the operator and the controller know from elsewhere."""

import numpy as np
import pytest

from hw.lite6.kinematics import JOINT_LOWER, JOINT_UPPER
from hw.sim import layout
from hw.sim.operator.vision.pinhole import fixed_cameras
from hw.sim.world.scene import build_model
from hw.sim.world.world import JOINTS, STEP_NS

pytestmark = pytest.mark.untimed

LAYOUT = layout.draw_layout(3)
WALL_HALF = layout.CONTAINER_WALL_M / 2
OUTER_HALF = layout.CONTAINER_INNER_M / 2 + layout.CONTAINER_WALL_M


@pytest.fixture(scope="module")
def model():
    return build_model(LAYOUT, textured=True)


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
