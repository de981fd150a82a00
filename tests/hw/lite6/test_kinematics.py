"""Forward and inverse kinematics of the Lite 6 against UFACTORY's known poses and as laws."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from hw.lite6.kinematics import (
    HOME_JOINTS,
    JOINT_LOWER,
    JOINT_UPPER,
    Lite6Model,
    forward,
    jacobian,
    matrix_from_pose,
    offset_from_mm_deg,
    pose_from_matrix,
    rotation_from_rpy,
    rotation_matrix,
    rotation_vector,
    rpy_from_matrix,
    solve_ik,
    tcp_pose,
    within_joint_limits,
)
from tams_app.config import ArmConfig
from tams_app.records import Vector

pytestmark = pytest.mark.untimed

GRIPPER = offset_from_mm_deg((0, 0, 82, 0, 0, 0))
# where the wrist and the elbow are neither stretched nor folded
WORKING_RANGE = ((-2, 2), (-0.8, 1.0), (0.3, 2.5), (-1, 1), (0.3, 1.8), (-2, 2))

working_joints = st.tuples(*(st.floats(low, high) for low, high in WORKING_RANGE)).map(np.array)
any_joints = st.tuples(
    *(st.floats(low, high) for low, high in zip(JOINT_LOWER, JOINT_UPPER, strict=True))
).map(np.array)
rotation_vectors = st.tuples(*[st.floats(-1.8, 1.8)] * 3).map(np.array)


def test_zero_joints_put_the_flange_where_the_manual_says() -> None:
    flange = forward(np.zeros(6))
    np.testing.assert_allclose(flange[:3, 3], [0.087, 0.0, 0.1542], atol=1e-12)
    np.testing.assert_allclose(np.abs(rpy_from_matrix(flange)), [math.pi, 0, 0], atol=1e-12)


def test_home_joints_put_the_flange_where_the_manual_says() -> None:
    np.testing.assert_allclose(forward(HOME_JOINTS)[:3, 3], [0.200, 0.0, 0.2001], atol=1e-4)


def test_the_configured_ready_pose_holds_the_gripper_down_over_the_table() -> None:
    ready = tcp_pose(np.radians(ArmConfig().ready_joints_deg), GRIPPER)
    np.testing.assert_allclose(ready.position, [0.350, 0.0, 0.180], atol=1e-4)
    np.testing.assert_allclose(ready.rotation.apply([0, 0, 1]), [0, 0, -1], atol=1e-3)


def test_the_tcp_lies_along_the_flange_axis_by_its_offset() -> None:
    flange = forward(HOME_JOINTS)
    tcp = tcp_pose(HOME_JOINTS, GRIPPER)
    np.testing.assert_allclose(tcp.position, flange[:3, 3] + 0.082 * flange[:3, 2], atol=1e-12)


@given(any_joints)
@settings(deadline=None)
def test_the_jacobian_is_the_derivative_of_the_pose(joints: Vector) -> None:
    model = Lite6Model(GRIPPER)
    step = 1e-6
    numeric = np.empty((6, 6))
    for joint in range(6):
        change = np.zeros(6)
        change[joint] = step
        before, after = model.tcp_matrix(joints - change), model.tcp_matrix(joints + change)
        numeric[:3, joint] = (after - before)[:3, 3] / (2 * step)
        numeric[3:, joint] = rotation_vector(after[:3, :3] @ before[:3, :3].T) / (2 * step)
    np.testing.assert_allclose(model.jacobian(joints), numeric, atol=1e-7)
    np.testing.assert_array_equal(jacobian(joints, GRIPPER), model.jacobian(joints))


@given(working_joints, st.tuples(*[st.floats(-0.3, 0.3)] * 6).map(np.array))
@settings(deadline=None)
def test_the_inverse_reaches_every_pose_of_the_working_range(
    joints: Vector, seed_error: Vector
) -> None:
    target = tcp_pose(joints, GRIPPER)
    found = solve_ik(target, joints + seed_error, GRIPPER)
    assert found is not None
    assert within_joint_limits(found)
    reached = tcp_pose(found, GRIPPER)
    np.testing.assert_allclose(reached.position, target.position, atol=2e-6)
    assert (reached.rotation * target.rotation.inv()).magnitude() < 2e-6


def test_a_pose_out_of_reach_has_no_inverse() -> None:
    target = tcp_pose(HOME_JOINTS)
    target.position[0] = 0.8
    assert solve_ik(target, HOME_JOINTS) is None


def test_a_solution_beyond_a_joint_limit_does_not_count() -> None:
    beyond = np.array([0.0, 0.6, 1.5, 0.0, 2.30, 0.0])
    assert beyond[4] > JOINT_UPPER[4]
    assert solve_ik(tcp_pose(beyond), beyond) is None


def test_one_inverse_step_reports_the_error_it_started_from() -> None:
    model = Lite6Model()
    joints = np.radians(ArmConfig().ready_joints_deg)
    target = model.tcp_matrix(joints)
    target[:3, 3] += [0.002, 0.0, -0.001]
    moved, error = model.ik_step(joints, target)
    np.testing.assert_allclose(error, [0.002, 0, -0.001, 0, 0, 0], atol=1e-12)
    np.testing.assert_allclose(model.tcp_matrix(moved)[:3, 3], target[:3, 3], atol=2e-5)


@given(st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1)))
def test_roll_pitch_yaw_turn_about_the_fixed_axes_in_this_order(
    rpy: tuple[float, float, float],
) -> None:
    roll, pitch, yaw = rpy
    written_out = (
        Rotation.from_rotvec([0, 0, yaw])
        * Rotation.from_rotvec([0, pitch, 0])
        * Rotation.from_rotvec([roll, 0, 0])
    )
    matrix = rotation_from_rpy(rpy).as_matrix()
    np.testing.assert_allclose(matrix, written_out.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(rpy_from_matrix(matrix), rpy, atol=1e-7)


@given(rotation_vectors)
def test_rotation_vectors_agree_with_scipy(vector: Vector) -> None:
    rotation = Rotation.from_rotvec(vector)
    np.testing.assert_allclose(rotation_matrix(vector), rotation.as_matrix(), atol=1e-12)
    back = rotation_vector(rotation.as_matrix())
    np.testing.assert_allclose(
        Rotation.from_rotvec(back).as_matrix(), rotation.as_matrix(), atol=1e-9
    )


@pytest.mark.parametrize("angle", [0.0, 1e-14, 1e-7, math.pi - 1e-5, math.pi])
def test_rotation_vectors_hold_at_no_turn_and_at_half_a_turn(angle: float) -> None:
    axis = np.array([0.6, 0.0, 0.8])
    found = rotation_vector(Rotation.from_rotvec(axis * angle).as_matrix())
    assert np.linalg.norm(found) == pytest.approx(angle, abs=1e-7)
    np.testing.assert_allclose(np.abs(found), axis * angle, atol=1e-7)


def test_a_pose_survives_the_way_through_its_matrix() -> None:
    pose = offset_from_mm_deg((12, -3, 82, 10, 20, 30))
    back = pose_from_matrix(matrix_from_pose(pose))
    np.testing.assert_allclose(back.position, [0.012, -0.003, 0.082])
    assert (back.rotation * pose.rotation.inv()).magnitude() < 1e-12
