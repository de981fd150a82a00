"""Kinematics of the UFACTORY Lite 6: TCP, Jacobian and inverse, in metres and radians.

Modified (Craig) DH parameters of UFACTORY's manual (FINDINGS 8). Joint angles are arrays of
shape (6,), transforms of shape (4, 4) in the base frame (z up), twists and Jacobian rows
(vx, vy, vz, wx, wy, wz) of the TCP, in the base frame.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hw.lite6.commands import LIMITS
from tams_app.records import Pose, Vector
from tams_app.rotation import Rotation
from tams_app.vectors import ZERO, Floats3, cross, floats, minus, plus_times, times

Matrix: TypeAlias = NDArray[np.float64]

JOINTS = 6
BASE_TO_SHOULDER_M = 0.2433

_THETA_0 = np.radians([0.0, -90.0, -90.0, 0.0, 0.0, 0.0])
_D = (BASE_TO_SHOULDER_M, 0.0, 0.0, 0.2276, 0.0, 0.0615)
_ALPHA = np.radians([0.0, -90.0, 180.0, 90.0, 90.0, -90.0])
_A = (0.0, 0.0, 0.200, 0.087, 0.0, 0.0)

JOINT_LOWER: Vector = np.radians(LIMITS.joint_lower_deg)
JOINT_UPPER: Vector = np.radians(LIMITS.joint_upper_deg)
JOINT_SPEED_LIMITS: Vector = np.full(JOINTS, LIMITS.joint_speed_rad_s)
HOME_JOINTS: Vector = np.radians([0.0, 9.9, 31.8, 0.0, 21.9, 0.0])

_IK_MAX_STEP_RAD = 0.3
_IK_MIN_DAMPING = 1e-12
_IK_ERROR_DAMPING = 0.01
_FOLLOW_TOLERANCE = 5e-6
_LINEAR_STEP_RAD = 0.004  # what a step this small leaves out of the arc is 0.5·440 mm·0.004² < 5 µm


_TWISTS = tuple(zip(np.cos(_ALPHA).tolist(), np.sin(_ALPHA).tolist(), strict=True))

for _constant in (JOINT_LOWER, JOINT_UPPER, JOINT_SPEED_LIMITS, HOME_JOINTS):
    _constant.setflags(write=False)


_Axes: TypeAlias = tuple[Floats3, Floats3, Floats3, Floats3]  # x, y, z and the origin


def _links(joints: Vector) -> Iterator[_Axes]:
    """The frames of the six links in the base frame, the flange last.

    Each is the one before times Rot_x(alpha) Trans_x(a) Rot_z(theta) Trans_z(d).
    """
    x, y, z, origin = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), ZERO
    angles = (joints + _THETA_0).tolist()
    for angle, (cos, sin), a, d in zip(angles, _TWISTS, _A, _D, strict=True):
        origin = plus_times(origin, x, a)
        y, z = plus_times(times(y, cos), z, sin), plus_times(times(z, cos), y, -sin)
        cos, sin = math.cos(angle), math.sin(angle)
        x, y = plus_times(times(x, cos), y, sin), plus_times(times(y, cos), x, -sin)
        origin = plus_times(origin, z, d)
        yield x, y, z, origin


def link_frames(joints: Vector) -> Matrix:
    """Frames of the six links in the base frame, shape (6, 4, 4); the last is the flange."""
    return _transforms(list(_links(joints)))


def _transforms(links: list[_Axes]) -> Matrix:
    """Frames as transforms, shape (n, 4, 4)."""
    frames = np.zeros((len(links), 4, 4))
    frames[:, :3] = np.array(links).transpose(0, 2, 1)
    frames[:, 3, 3] = 1.0
    return frames


class Lite6Model:
    """The Lite 6 with a tool; it satisfies `hw.arm.ArmKinematics`."""

    joint_speed_limits: Vector = JOINT_SPEED_LIMITS  # [rad/s]

    def __init__(self, tcp_offset: Pose | None = None) -> None:
        self._offset = np.eye(4) if tcp_offset is None else matrix_from_pose(tcp_offset)
        self._tool = floats(self._offset[:3, 3])

    def tcp_matrix(self, joints: Vector) -> Matrix:
        """The TCP in the base frame, shape (4, 4)."""
        tcp: Matrix = link_frames(joints)[-1] @ self._offset
        return tcp

    def tcp_pose(self, joints: Vector) -> Pose:
        """The TCP in the base frame."""
        return pose_from_matrix(self.tcp_matrix(joints))

    def jacobian(self, joints: Vector) -> Matrix:
        """Joint speeds [rad/s] to the TCP's twist [m/s, rad/s] in the base frame, shape (6, 6)."""
        return self._jacobian(list(_links(joints)))

    def tcp_and_jacobian(self, joints: Vector) -> tuple[Matrix, Matrix]:
        """`tcp_matrix` and `jacobian` for the price of one."""
        links = list(_links(joints))
        return _transforms(links[-1:])[0] @ self._offset, self._jacobian(links)

    def _jacobian(self, links: list[_Axes]) -> Matrix:
        (x, y, z, tcp), tool = links[-1], self._tool
        for axis, part in zip((x, y, z), tool, strict=True):
            tcp = plus_times(tcp, axis, part)
        return np.array([(*cross(axis, minus(tcp, at)), *axis) for _, _, axis, at in links]).T

    def follow(self, target: Matrix, joints: Vector, max_steps: int = 10) -> Vector | None:
        """Joints that put a TCP that is nearly there at `target`, within 10 µm and 10 µrad.

        None if they are not found, as beyond the reach of the arm. Joint limits do not count.
        Damped least squares whose damping grows with the error (Levenberg-Marquardt), so that far
        targets and singular poses do not make the joints jump and near ones converge fast.
        """
        for _ in range(max_steps):
            tcp, rows = self.tcp_and_jacobian(joints)
            error = np.empty(6)
            error[:3] = target[:3, 3] - tcp[:3, 3]
            error[3:] = rotation_vector(target[:3, :3] @ tcp[:3, :3].T)
            damping = _IK_MIN_DAMPING + _IK_ERROR_DAMPING * float(error @ error)
            normal = rows.T @ rows
            normal.flat[:: JOINTS + 1] += damping
            change = np.asarray(np.linalg.solve(normal, rows.T @ error), dtype=np.float64)
            largest = float(np.abs(change).max())
            if largest > _IK_MAX_STEP_RAD:
                change *= _IK_MAX_STEP_RAD / largest
            joints = joints + change
            left = float(np.abs(error - rows @ change).max())
            if left < _FOLLOW_TOLERANCE and float(np.abs(change).max()) < _LINEAR_STEP_RAD:
                return joints
        return None


def within_joint_limits(joints: Vector) -> bool:
    """Whether every joint is inside its mechanical range."""
    return bool((joints >= JOINT_LOWER).all() and (joints <= JOINT_UPPER).all())


def rotation_vector(matrix: Matrix) -> Vector:
    """Axis times angle [rad] of a rotation matrix, shape (3,)."""
    sine_axis: Vector = 0.5 * np.array(
        [
            matrix[2, 1] - matrix[1, 2],
            matrix[0, 2] - matrix[2, 0],
            matrix[1, 0] - matrix[0, 1],
        ]
    )
    cosine = 0.5 * (matrix[0, 0] + matrix[1, 1] + matrix[2, 2] - 1.0)
    sine = math.sqrt(float(sine_axis @ sine_axis))
    if cosine < 0.0 and sine < 1e-3:  # near half a turn the axis is lost in the rounding
        return np.asarray(Rotation.from_matrix(matrix).as_rotvec(), dtype=np.float64)
    if sine < 1e-12:
        return sine_axis
    return sine_axis * (math.atan2(sine, cosine) / sine)


def rotation_matrix(vector: Vector) -> Matrix:
    """The rotation matrix of axis times angle [rad] (Rodrigues), shape (3, 3)."""
    x, y, z = (float(part) for part in vector)
    angle = math.sqrt(x * x + y * y + z * z)
    skew: Matrix = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    turn: Matrix = np.eye(3) + skew
    if angle > 1e-12:
        half = math.sin(0.5 * angle) / angle
        turn = np.eye(3) + (math.sin(angle) / angle) * skew + 2.0 * half * half * (skew @ skew)
    return turn


def rotation_from_rpy(rpy: Sequence[float] | Vector) -> Rotation:
    """UFACTORY's roll, pitch, yaw [rad]: Rz(yaw) Ry(pitch) Rx(roll)."""
    roll, pitch, yaw = rpy
    sr, cr = math.sin(roll / 2), math.cos(roll / 2)
    sp, cp = math.sin(pitch / 2), math.cos(pitch / 2)
    sy, cy = math.sin(yaw / 2), math.cos(yaw / 2)
    return Rotation(
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )


def rpy_from_matrix(matrix: Matrix) -> Vector:
    """UFACTORY's roll, pitch, yaw [rad] of a rotation matrix, shape (3,)."""
    return np.array(
        [
            math.atan2(matrix[2, 1], matrix[2, 2]),
            math.asin(max(-1.0, min(1.0, -matrix[2, 0]))),
            math.atan2(matrix[1, 0], matrix[0, 0]),
        ]
    )


def pose_from_mm_rpy(values: Sequence[float] | Vector) -> Pose:
    """A pose from x, y, z [mm] and roll, pitch, yaw [rad], as the controller writes it."""
    return Pose(np.asarray(values[:3], dtype=np.float64) / 1000.0, rotation_from_rpy(values[3:6]))


def offset_from_mm_deg(values: Sequence[float]) -> Pose:
    """A TCP offset from x, y, z [mm] and roll, pitch, yaw [deg], as the configuration writes it."""
    return pose_from_mm_rpy([*values[:3], *(math.radians(angle) for angle in values[3:6])])


def matrix_from_pose(pose: Pose) -> Matrix:
    """A pose as a transform, shape (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = pose.rotation.as_matrix()
    matrix[:3, 3] = pose.position
    return matrix


def pose_from_matrix(matrix: Matrix) -> Pose:
    """A transform, shape (4, 4), as a pose."""
    return Pose(matrix[:3, 3].copy(), Rotation.from_matrix(matrix[:3, :3]))
