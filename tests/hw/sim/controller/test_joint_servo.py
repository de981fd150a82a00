"""The servo of mode 5, the moves of mode 0, the brake, and the checks of every cycle."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.arm import TcpBoundary
from hw.lite6.kinematics import (
    HOME_JOINTS,
    JOINT_LOWER,
    JOINT_UPPER,
    Lite6Model,
    Matrix,
    offset_from_mm_deg,
    rotation_matrix,
    rotation_vector,
)
from hw.lite6.protocol import ErrorCode
from hw.sim.controller.joint_servo import (
    CYCLE_NS,
    CYCLE_S,
    MAX_JOINT_ACCELERATION,
    VELOCITY_ACCELERATION_M_S2,
    MotionError,
    MoveServo,
    TwistServo,
    brake,
    check_motion,
)
from tams_app.records import Vector
from tams_app.vectors import ZERO

pytestmark = pytest.mark.untimed

MODEL = Lite6Model(offset_from_mm_deg((0, 0, 82, 0, 0, 0)))
READY = np.radians([0, 36.81, 86.74, 0, 49.93, 0])
START = MODEL.tcp_matrix(READY)


def moved(
    *, by: tuple[float, float, float], turn: tuple[float, float, float] = (0, 0, 0)
) -> Matrix:
    """The ready pose, moved [m] and turned [rad] in the base frame."""
    target = START.copy()
    target[:3, 3] += by
    target[:3, :3] = rotation_matrix(np.array(turn)) @ target[:3, :3]
    return target


def run_twist(servo: TwistServo, joints: Vector, now_ns: int, cycles: int) -> list[Vector]:
    path = [joints]
    for cycle in range(1, cycles + 1):
        following = servo.step(path[-1], MODEL, now_ns + cycle * CYCLE_NS)
        path.append(path[-1] if following is None else following)
    return path


def tcp_positions(path: list[Vector]) -> Matrix:
    return np.array([MODEL.tcp_matrix(joints)[:3, 3] for joints in path])


# --- mode 5 -------------------------------------------------------------------------------------


def test_a_twist_moves_the_tcp_on_a_straight_line_without_turning_it() -> None:
    servo = TwistServo()
    servo.command(np.array([0.0, 0.06, 0.08, 0, 0, 0]), 0.0, 0)
    path = run_twist(servo, READY, 0, 250)
    way = tcp_positions(path) - START[:3, 3]
    np.testing.assert_allclose(way[:, 0], 0.0, atol=2e-5)
    np.testing.assert_allclose(way[:, 1] * 0.08, way[:, 2] * 0.06, atol=2e-6)
    assert way[-1, 1] == pytest.approx(0.06, abs=0.001)  # a second, less the acceleration
    turned = MODEL.tcp_matrix(path[-1])[:3, :3] @ START[:3, :3].T
    assert np.linalg.norm(rotation_vector(turned)) < 1e-4


def test_a_twist_turns_the_tcp_about_its_own_point() -> None:
    servo = TwistServo()
    servo.command(np.array([0, 0, 0, 0.0, 0.0, 0.4]), 0.0, 0)
    path = run_twist(servo, READY, 0, 125)
    np.testing.assert_allclose(tcp_positions(path), np.tile(START[:3, 3], (126, 1)), atol=2e-5)
    turned = rotation_vector(MODEL.tcp_matrix(path[-1])[:3, :3] @ START[:3, :3].T)
    np.testing.assert_allclose(turned, [0, 0, 0.2], atol=0.005)


def test_speed_comes_and_goes_with_seven_metres_a_second_squared() -> None:
    servo = TwistServo()
    servo.command(np.array([0.0, 0.21, 0, 0, 0, 0]), 0.0, 0)
    path = run_twist(servo, READY, 0, 20)
    servo.command(np.zeros(6), 0.0, 20 * CYCLE_NS)
    path += run_twist(servo, path[-1], 20 * CYCLE_NS, 20)[1:]
    speed = np.diff(tcp_positions(path)[:, 1]) / CYCLE_S
    np.testing.assert_allclose(speed[:7], 0.028 * np.arange(1, 8), rtol=0, atol=0.003)
    np.testing.assert_allclose(speed[20:26], 0.21 - 0.028 * np.arange(1, 7), rtol=0, atol=0.003)
    assert speed[8:20] == pytest.approx(0.21, abs=0.004)
    assert not speed[29:].any()


@given(st.lists(st.tuples(*[st.floats(-0.2, 0.2)] * 3), min_size=1, max_size=4))
@settings(deadline=None, max_examples=15)
def test_the_tcp_never_accelerates_more_than_the_controller_does(
    commands: list[tuple[float, float, float]],
) -> None:
    servo, path, now_ns = TwistServo(), [READY], 0
    for command in commands:
        servo.command(np.array([*command, 0, 0, 0]), 0.0, now_ns)
        path += run_twist(servo, path[-1], now_ns, 15)[1:]
        now_ns += 15 * CYCLE_NS
    velocity = np.diff(tcp_positions(path), axis=0, prepend=[START[:3, 3]]) / CYCLE_S
    change = np.linalg.norm(np.diff(velocity, axis=0), axis=1)
    # the joints follow the path to within 10 micrometres
    assert change.max() <= VELOCITY_ACCELERATION_M_S2 * CYCLE_S + 4e-5 / CYCLE_S


def test_a_twist_that_leads_out_of_reach_is_a_kinematic_error_or_an_overspeed() -> None:
    servo = TwistServo()
    servo.command(np.array([0.3, 0.0, 0, 0, 0, 0]), 0.0, 0)
    path: list[Vector] = [READY]
    code: ErrorCode | None = None
    while code is None and len(path) < 500:
        try:
            path += run_twist(servo, path[-1], len(path) * CYCLE_NS, 1)[1:]
            check_motion(path[-2], path[-1], ZERO, None, self_collision=True)
        except MotionError as fault:
            code = fault.code
    assert code in (ErrorCode.KINEMATIC, ErrorCode.JOINT_OVERSPEED)
    reach = np.linalg.norm(tcp_positions(path), axis=1)
    assert reach.max() < 0.6


# --- the brake ----------------------------------------------------------------------------------


def test_the_brake_stops_on_the_line_of_motion_at_the_joints_acceleration() -> None:
    joints, velocity = HOME_JOINTS, np.array([1.0, -0.5, 0.25, 0, 0, 0])
    cycles = 0
    while any(velocity):
        joints, slower = brake(joints, velocity)
        assert np.abs(np.subtract(velocity, slower)).max() <= MAX_JOINT_ACCELERATION * CYCLE_S * (
            1 + 1e-9
        )
        np.testing.assert_allclose(np.cross(slower[:3], [1.0, -0.5, 0.25]), 0.0, atol=1e-12)
        velocity = slower
        cycles += 1
    assert cycles * CYCLE_S == pytest.approx(1.0 / MAX_JOINT_ACCELERATION, abs=2 * CYCLE_S)


def test_the_brake_does_not_run_over_a_joint_limit() -> None:
    joints = JOINT_UPPER - 0.001
    velocity = np.full(6, 3.0)
    for _ in range(50):
        joints, velocity = brake(joints, velocity)
    assert (joints <= JOINT_UPPER).all()


# --- mode 0 -------------------------------------------------------------------------------------

BEGIN = np.zeros(6)


def run(servo: MoveServo, joints: Vector, cycles: int = 10_000) -> Matrix:
    """The joints of every cycle until the servo has nothing more to do."""
    path = [joints]
    for _ in range(cycles):
        following = servo.step(path[-1])
        if following is None:
            break
        path.append(following)
    return np.array(path)


@given(
    st.floats(0.01, 2.0),
    st.tuples(*[st.floats(-1.0, 1.0)] * 5),
    st.floats(0.5, 10.0),
    st.floats(1.0, 40.0),
)
@settings(deadline=None, max_examples=30)
def test_a_move_runs_straight_to_its_goal_in_the_time_that_speed_and_acceleration_take(
    way: float, others: tuple[float, ...], speed: float, acceleration: float
) -> None:
    servo, goal = MoveServo(), way * np.array([1.0, *others])
    servo.command(goal, speed, acceleration)
    path = run(servo, BEGIN)
    np.testing.assert_array_equal(path[-1], goal)
    np.testing.assert_allclose(path, path[:, :1] / way * goal, atol=1e-12)
    fastest, allowed = min(speed, math.pi), min(acceleration, MAX_JOINT_ACCELERATION)
    velocity = np.diff(path[:, 0], prepend=0.0, append=way) / CYCLE_S
    assert velocity.max() <= fastest + 1e-9
    assert velocity.min() >= 0.0
    assert np.abs(np.diff(velocity)).max() <= allowed * CYCLE_S * (1 + 1e-6)
    top = min(fastest, math.sqrt(way * allowed))
    assert (len(path) - 1) * CYCLE_S == pytest.approx(way / top + top / allowed, abs=1.01 * CYCLE_S)
    assert not servo.busy


def test_a_move_to_where_the_joints_are_is_done_at_once() -> None:
    servo = MoveServo()
    servo.command(BEGIN, 1.0, 1.0)
    assert len(run(servo, BEGIN)) == 2


def test_an_interrupted_move_goes_on_from_where_the_joints_came_to() -> None:
    servo, goal = MoveServo(), np.array([0.5, -0.2, 1.0, 0.0, 0.3, -0.8])
    servo.command(goal, 1.0, 5.0)
    elsewhere = run(servo, BEGIN, cycles=100)[-1] + 0.01
    servo.interrupt()
    assert servo.busy
    path = run(servo, elsewhere)
    assert np.abs(path[1] - elsewhere).max() < 0.001
    np.testing.assert_array_equal(path[-1], goal)


# --- the checks ---------------------------------------------------------------------------------

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
