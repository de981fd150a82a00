"""The task's region in a session's frames: where the cameras see the tool, by the arm's report."""

from __future__ import annotations

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest

from hw.arms import arm_kind
from hw.sim.layout import HEIGHT_PX, VIEWS, WIDTH_PX, draw_layout
from hw.sim.world.scene import build_model
from tams_app.config import CONFIG_DIRECTORY, load_config
from tams_app.records import Activity, ArmState, Frame, ServoMode
from tams_app.session.task_place import task_regions
from tests.synthetic_session import tick

pytestmark = pytest.mark.untimed

TURNS = ((0.0,) * 6, (0.2, 0.1, 0.1, 0.0, -0.1, 0.3), (-0.3, 0.15, 0.2, 0.1, 0.1, -0.4))


def seen_by(model: mujoco.MjModel, data: mujoco.MjData, view: str) -> tuple[float, float]:
    """Where MuJoCo's camera sees the rig's own tool centre point [px]."""
    camera, site = model.camera(view).id, model.site("tcp").id
    axes = data.cam_xmat[camera].reshape(3, 3)
    right, up, back = axes.T @ (data.site_xpos[site] - data.cam_xpos[camera])
    focal = HEIGHT_PX / 2 / math.tan(math.radians(model.cam_fovy[camera]) / 2)
    return WIDTH_PX / 2 - 0.5 - focal * right / back, HEIGHT_PX / 2 - 0.5 + focal * up / back


@pytest.mark.parametrize("turn_rad", TURNS)
def test_each_view_of_the_rig_has_the_region_where_its_camera_sees_the_tool(
    turn_rad: tuple[float, ...],
) -> None:
    config = load_config()
    joints = np.radians(config.arm.ready_joints_deg) + turn_rad
    model = build_model(draw_layout(3), textured=False)
    data = mujoco.MjData(model)
    data.qpos[:6] = joints
    mujoco.mj_kinematics(model, data)
    mujoco.mj_camlight(model, data)
    tcp = arm_kind(config.arm.model).kinematics(config.arm).tcp_pose(joints)
    state = ArmState(0, joints, tcp, Activity.MOVING, ServoMode.VELOCITY, None, None)

    regions, frames = task_regions(config), list[Frame]()
    regions.receive(replace(tick(0), arm=state))
    give = regions.through(frames.append)
    for view in VIEWS:
        give(Frame(view, 5, 0, np.zeros((HEIGHT_PX, WIDTH_PX, 3), np.uint8)))

    assert [(frame.view, frame.index) for frame in frames] == [(view, 5) for view in VIEWS]
    for frame in frames:
        assert frame.task is not None
        seen = seen_by(model, data, frame.view)
        assert (frame.task.x_px, frame.task.y_px) == pytest.approx(seen, abs=1.0)


def test_before_the_arm_has_reported_only_the_camera_that_moves_with_it_has_a_region() -> None:
    regions = task_regions(load_config())
    assert {view: regions.of(view) is not None for view in VIEWS} == {
        "eih": True,
        "gt": False,
        "gs": False,
    }


def test_a_real_place_whose_cameras_are_not_known_has_no_region() -> None:
    config = load_config(CONFIG_DIRECTORY / "lite6.yaml")
    regions = task_regions(config)
    assert [regions.of(view) for view in config.video.views] == [None] * 3
