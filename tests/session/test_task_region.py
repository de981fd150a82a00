"""Where a camera sees the task: around the tool, whatever the picture shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.prediction.plane_warp import projected
from tams_app.records import Lens, Pose
from tams_app.rotation import Rotation
from tams_app.session.task_place import LEAST_RADIUS_PX, RADIUS_M, task_region

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
    (x_px, y_px), (edge_px, _) = projected(
        np.array([tcp, (tcp[0] + RADIUS_M, tcp[1], tcp[2])]), AHEAD
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
