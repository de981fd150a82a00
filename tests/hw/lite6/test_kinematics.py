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
    Matrix,
    matrix_from_pose,
    offset_from_mm_deg,
    pose_from_matrix,
    rotation_from_rpy,
    rotation_matrix,
    rotation_vector,
    rpy_from_matrix,
    within_joint_limits,
)
from tams_app.config import ArmConfig
from tams_app.records import Vector
from tams_app.vectors import Joints, floats

pytestmark = pytest.mark.untimed

GRIPPER_ARM = Lite6Model(offset_from_mm_deg((0, 0, 82, 0, 0, 0)))
# where the wrist and the elbow are neither stretched nor folded
WORKING_RANGE = ((-2, 2), (-0.8, 1.0), (0.3, 2.5), (-1, 1), (0.3, 1.8), (-2, 2))

working_joints = st.tuples(*(st.floats(low, high) for low, high in WORKING_RANGE)).map(np.array)
any_joints = st.tuples(
    *(st.floats(low, high) for low, high in zip(JOINT_LOWER, JOINT_UPPER, strict=True))
).map(np.array)
rotation_vectors = st.tuples(*[st.floats(-1.8, 1.8)] * 3).map(np.array)


def test_zero_joints_put_the_flange_where_the_manual_says() -> None:
    flange = Lite6Model().tcp_matrix(np.zeros(6))
    np.testing.assert_allclose(flange[:3, 3], [0.087, 0.0, 0.1542], atol=1e-12)
    np.testing.assert_allclose(np.abs(rpy_from_matrix(flange[:3, :3])), [math.pi, 0, 0], atol=1e-12)


def test_home_joints_put_the_flange_where_the_manual_says() -> None:
    flange = Lite6Model().tcp_matrix(HOME_JOINTS)
    np.testing.assert_allclose(flange[:3, 3], [0.200, 0.0, 0.2001], atol=1e-4)


def test_the_configured_ready_pose_holds_the_gripper_down_over_the_table() -> None:
    ready = GRIPPER_ARM.tcp_pose(np.radians(ArmConfig().ready_joints_deg))
    np.testing.assert_allclose(ready.position, [0.350, 0.0, 0.180], atol=1e-4)
    np.testing.assert_allclose(ready.rotation.apply([0, 0, 1]), [0, 0, -1], atol=1e-3)


def test_the_tcp_lies_along_the_flange_axis_by_its_offset() -> None:
    flange = Lite6Model().tcp_matrix(HOME_JOINTS)
    tcp = GRIPPER_ARM.tcp_pose(HOME_JOINTS)
    np.testing.assert_allclose(tcp.position, flange[:3, 3] + 0.082 * flange[:3, 2], atol=1e-12)


@given(any_joints)
@settings(deadline=None)
def test_the_jacobian_is_the_derivative_of_the_pose(joints: Vector) -> None:
    model = GRIPPER_ARM
    step = 1e-6
    numeric = np.empty((6, 6))
    for joint in range(6):
        change = np.zeros(6)
        change[joint] = step
        before, after = model.tcp_matrix(joints - change), model.tcp_matrix(joints + change)
        numeric[:3, joint] = (after - before)[:3, 3] / (2 * step)
        turn = rotation_vector(after[:3, :3] @ before[:3, :3].T)
        numeric[3:, joint] = np.array(turn) / (2 * step)
    np.testing.assert_allclose(model.jacobian(joints), numeric, atol=1e-7)


def inverse(arm: Lite6Model, target: Matrix, joints: Vector, max_steps: int = 10) -> Joints | None:
    return arm.approach(floats(target[:3, 3]), target[:3, :3], joints, max_steps)


@given(working_joints, st.tuples(*[st.floats(-0.3, 0.3)] * 6).map(np.array))
@settings(deadline=None)
def test_the_inverse_reaches_every_pose_of_the_working_range(
    joints: Vector, start_error: Vector
) -> None:
    target = GRIPPER_ARM.tcp_matrix(joints)
    found = inverse(GRIPPER_ARM, target, joints + start_error, max_steps=60)
    assert found is not None
    reached = GRIPPER_ARM.tcp_matrix(found)
    np.testing.assert_allclose(reached[:3, 3], target[:3, 3], atol=1e-5)
    assert np.abs(rotation_vector(reached[:3, :3] @ target[:3, :3].T)).max() < 1e-5


def test_the_inverse_counts_a_turned_tool() -> None:
    arm = Lite6Model(offset_from_mm_deg((10, -20, 82, 30, -40, 50)))
    found = inverse(arm, arm.tcp_matrix(HOME_JOINTS), HOME_JOINTS + 0.01)
    np.testing.assert_allclose(found, HOME_JOINTS, atol=1e-4)


def test_a_pose_out_of_reach_has_no_inverse() -> None:
    target = GRIPPER_ARM.tcp_matrix(HOME_JOINTS)
    target[0, 3] = 0.8
    assert inverse(GRIPPER_ARM, target, HOME_JOINTS) is None


def test_joints_are_within_their_limits_up_to_the_last_one() -> None:
    assert within_joint_limits(JOINT_UPPER)
    assert not within_joint_limits(JOINT_UPPER + np.array([0.0, 0.0, 0.0, 0.0, 1e-6, 0.0]))


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


def test_a_pose_survives_its_matrix() -> None:
    pose = offset_from_mm_deg((12, -3, 82, 10, 20, 30))
    back = pose_from_matrix(matrix_from_pose(pose))
    np.testing.assert_allclose(back.position, [0.012, -0.003, 0.082])
    assert (back.rotation * pose.rotation.inv()).magnitude() < 1e-12
