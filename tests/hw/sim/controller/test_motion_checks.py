"""The controller's checks of every cycle."""

from __future__ import annotations

import numpy as np
import pytest

from hw.arm import TcpBoundary
from hw.lite6.codes import ErrorCode
from hw.lite6.kinematics import HOME_JOINTS, JOINT_LOWER, JOINT_UPPER, Lite6Model
from hw.sim.controller.joint_servo import CYCLE_S, MotionError, check_motion
from tams_app.records import Vector
from tams_app.vectors import ZERO

pytestmark = pytest.mark.untimed

NO_TOOL = ZERO
LIMIT_STEP = np.pi * CYCLE_S


def box(middle_mm, half_mm):
    return TcpBoundary(tuple(middle_mm - half_mm), tuple(middle_mm + half_mm))


def check(joints: Vector, following: Vector, fence: TcpBoundary | None = None) -> None:
    check_motion(joints, following, NO_TOOL, fence, self_collision=True)


@pytest.mark.parametrize("joint", range(6))
def test_a_joint_stops_at_either_end_of_its_range(joint: int) -> None:
    for end, outward in ((JOINT_UPPER, 1e-6), (JOINT_LOWER, -1e-6)):
        at_end = HOME_JOINTS.copy()
        at_end[joint] = end[joint]
        beyond = at_end.copy()
        beyond[joint] += outward
        check_motion(at_end, at_end, NO_TOOL, None, self_collision=False)
        with pytest.raises(MotionError) as caught:
            check_motion(at_end, beyond, NO_TOOL, None, self_collision=False)
        assert caught.value.code is ErrorCode.JOINT_LIMIT


@pytest.mark.parametrize("joint", range(6))
def test_no_joint_is_faster_than_half_a_turn_a_second(joint: int) -> None:
    step = np.zeros(6)
    step[joint] = LIMIT_STEP
    check(HOME_JOINTS, HOME_JOINTS + step)
    with pytest.raises(MotionError) as caught:
        check(HOME_JOINTS, HOME_JOINTS - 1.01 * step)
    assert caught.value.code is ErrorCode.JOINT_OVERSPEED


@pytest.mark.parametrize("axis", range(3))
def test_the_tcp_stays_inside_the_fence(axis: int) -> None:
    position_mm = Lite6Model().tcp_matrix(HOME_JOINTS)[:3, 3] * 1000
    fence = box(position_mm, 1.0)
    check(HOME_JOINTS, HOME_JOINTS, fence)
    for shift in (2.0, -2.0):
        moved = np.zeros(3)
        moved[axis] = shift
        outside = box(position_mm + moved, 1.0)
        with pytest.raises(MotionError) as caught:
            check(HOME_JOINTS, HOME_JOINTS, outside)
        assert caught.value.code is ErrorCode.BOUNDARY


def test_the_fence_is_about_the_tcp_and_not_the_flange() -> None:
    position_mm = Lite6Model().tcp_matrix(HOME_JOINTS)[:3, 3] * 1000
    fence = box(position_mm, 10.0)
    tool = 0.0, 0.0, 0.082
    with pytest.raises(MotionError):
        check_motion(HOME_JOINTS, HOME_JOINTS, tool, fence, self_collision=True)


def test_the_tool_keeps_clear_of_the_base_column() -> None:
    check(np.zeros(6), np.zeros(6))  # the manual's zero pose, 87 mm from the axis
    folded = np.array([0.0, 0.01, 0.03, 0.0, 1.41, 0.0])  # the flange points at the column
    with pytest.raises(MotionError) as caught:
        check(folded, folded)
    assert caught.value.code is ErrorCode.SELF_COLLISION
    check_motion(folded, folded, NO_TOOL, None, self_collision=False)
