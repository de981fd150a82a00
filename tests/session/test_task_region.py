"""Where a camera sees the task, around the tool, and where a session's cameras see it."""

from __future__ import annotations

import math
from dataclasses import replace

import mujoco
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.arms import arm_kind
from hw.sim.layout import HEIGHT_PX, VIEWS, WIDTH_PX, draw_layout
from hw.sim.world.scene import build_model
from tams_app.config import CONFIG_DIRECTORY, load_config
from tams_app.records import Activity, ArmState, Lens, Pose, ServoMode
from tams_app.rotation import Rotation
from tams_app.session.quality import LEAST_RADIUS_PX, RADIUS_M, task_region, task_regions
from tests.synthetic_session import tick

pytestmark = pytest.mark.untimed

AHEAD = Lens.ideal("base", Pose(np.zeros(3), Rotation.identity()), 60.0, 640, 480)
"""Looks along z from the origin."""


def turned(lens: Lens, turn: Rotation, moved: np.ndarray) -> Lens:
    pose = Pose(turn.apply(lens.pose.position) + moved, turn * lens.pose.rotation)
    return replace(lens, pose=pose)


@given(
    tcp=st.tuples(st.floats(-0.4, 0.4), st.floats(-0.3, 0.3), st.floats(0.05, 2.0)),
    turn=st.tuples(*(st.floats(-3, 3),) * 3),
    moved=st.tuples(*(st.floats(-1, 1),) * 3),
)
def test_the_region_is_the_disc_of_a_ball_about_the_tool_wherever_the_camera_is(
    tcp: tuple[float, float, float],
    turn: tuple[float, float, float],
    moved: tuple[float, float, float],
) -> None:
    rotation, shift = Rotation.from_rotvec(turn), np.array(moved)
    here = task_region(AHEAD, np.array(tcp))
    there = task_region(turned(AHEAD, rotation, shift), rotation.apply(np.array(tcp)) + shift)
    (x_px, y_px), (edge_px, _) = AHEAD.projected(
        np.array([tcp, (tcp[0] + RADIUS_M, tcp[1], tcp[2])])
    )
    inside = 0.01 < x_px < 639.99 and 0.01 < y_px < 479.99
    outside = not (-0.01 < x_px < 640.01 and -0.01 < y_px < 480.01)
    if outside:
        assert here is None
        assert there is None
    elif inside:
        assert (here.x_px, here.y_px) == pytest.approx((x_px, y_px))
        assert here.radius_px == pytest.approx(max(LEAST_RADIUS_PX, edge_px - x_px))
        assert (there.x_px, there.y_px, there.radius_px) == pytest.approx(
            (here.x_px, here.y_px, here.radius_px), abs=1e-6
        )


def test_a_tool_behind_the_camera_is_in_no_picture() -> None:
    assert task_region(AHEAD, np.array((0.0, 0.0, -0.5))) is None


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

    regions = task_regions(config)
    regions.receive(replace(tick(0), arm=state))
    for view in VIEWS:
        region = regions.of(view)
        assert region is not None
        seen = seen_by(model, data, view)
        assert (region.x_px, region.y_px) == pytest.approx(seen, abs=1.0)


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
