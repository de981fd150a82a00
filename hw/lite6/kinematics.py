"""Kinematics of the UFACTORY Lite 6: TCP, Jacobian and inverse, in metres and radians.

Modified (Craig) DH parameters of UFACTORY's manual (FINDINGS 8). Joint angles are arrays of
shape (6,), transforms of shape (4, 4) in the base frame (z up), twists and Jacobian rows
(vx, vy, vz, wx, wy, wz) of the TCP, in the base frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from operator import add, mul
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from hw.lite6.commands import LIMITS
from tams_app.records import Pose, Vector
from tams_app.rotation import Rotation
from tams_app.vectors import (
    Floats3,
    Joints,
    Numbers,
    cross,
    floats,
    minus,
    norm,
    plain,
    plus_times,
    times,
)

Matrix: TypeAlias = NDArray[np.float64]

JOINTS = 6
BASE_TO_SHOULDER_M = 0.2433

_THETA_0 = (0.0, -math.pi / 2, -math.pi / 2, 0.0, 0.0, 0.0)
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
_LINEAR_STEP_RAD = 0.002  # of each joint: a straight step leaves out about 5 µm and 5 µrad


_TWISTS = tuple(zip(np.cos(_ALPHA).tolist(), np.sin(_ALPHA).tolist(), strict=True))

JOINT_RANGES = tuple(zip(JOINT_LOWER.tolist(), JOINT_UPPER.tolist(), strict=True))

for _constant in (JOINT_LOWER, JOINT_UPPER, JOINT_SPEED_LIMITS, HOME_JOINTS):
    _constant.setflags(write=False)


Floats6: TypeAlias = tuple[float, float, float, float, float, float]
Axes: TypeAlias = tuple[Floats3, Floats3, Floats3, Floats3]  # x, y, z and the origin


def links(joints: Numbers) -> tuple[Axes, ...]:
    """The frames of the six links in the base frame, the flange last."""
    return _turned(plain(joints))


def _turned(angles: Sequence[float]) -> tuple[Axes, ...]:
    return _links(tuple(map(add, angles, _THETA_0)))


@lru_cache(maxsize=4)  # the controller model needs those of the same joints several times
def _links(angles: tuple[float, ...]) -> tuple[Axes, ...]:
    """Each is the one before times Rot_x(alpha) Trans_x(a) Rot_z(theta) Trans_z(d)."""
    # written out: half the time of the same with vectors
    xx, xy, xz = 1.0, 0.0, 0.0
    yx, yy, yz = 0.0, 1.0, 0.0
    zx, zy, zz = 0.0, 0.0, 1.0
    at_x = at_y = at_z = 0.0
    frames = []
    for angle, (cos, sin), a, d in zip(angles, _TWISTS, _A, _D, strict=True):
        at_x, at_y, at_z = at_x + xx * a, at_y + xy * a, at_z + xz * a
        yx, zx = yx * cos + zx * sin, zx * cos - yx * sin
        yy, zy = yy * cos + zy * sin, zy * cos - yy * sin
        yz, zz = yz * cos + zz * sin, zz * cos - yz * sin
        cos, sin = math.cos(angle), math.sin(angle)
        xx, yx = xx * cos + yx * sin, yx * cos - xx * sin
        xy, yy = xy * cos + yy * sin, yy * cos - xy * sin
        xz, yz = xz * cos + yz * sin, yz * cos - xz * sin
        at_x, at_y, at_z = at_x + zx * d, at_y + zy * d, at_z + zz * d
        frames.append(((xx, xy, xz), (yx, yy, yz), (zx, zy, zz), (at_x, at_y, at_z)))
    return tuple(frames)


def _transform(frame: Axes) -> Matrix:
    """A frame as a transform, shape (4, 4)."""
    transform = np.empty((4, 4))
    transform[:3] = np.array(frame).T
    transform[3] = 0.0, 0.0, 0.0, 1.0
    return transform


class Lite6Model:
    """The Lite 6 with a tool; it satisfies `ArmKinematics`."""

    joint_speed_limits: Vector = JOINT_SPEED_LIMITS  # [rad/s]
    joint_ranges = JOINT_RANGES  # [rad]

    def __init__(self, tcp_offset: Pose | None = None) -> None:
        self._offset = np.eye(4) if tcp_offset is None else matrix_from_pose(tcp_offset)
        self._tool = floats(self._offset[:3, 3])
        turn = self._offset[:3, :3]
        self._tool_turn = None if np.array_equal(turn, np.eye(3)) else turn

    def tcp_matrix(self, joints: Numbers) -> Matrix:
        """The TCP in the base frame, shape (4, 4)."""
        tcp: Matrix = _transform(links(joints)[-1]) @ self._offset
        return tcp

    def tcp_pose(self, joints: Vector) -> Pose:
        """The TCP in the base frame."""
        return pose_from_matrix(self.tcp_matrix(joints))

    def jacobian(self, joints: Numbers) -> Matrix:
        """Joint speeds [rad/s] to the TCP's twist [m/s, rad/s] in the base frame, shape (6, 6)."""
        return np.array(self._columns(links(joints))[0]).T

    def approach(
        self, goal: Floats3, turn: Matrix, joints: Numbers, max_steps: int = 10
    ) -> Joints | None:
        """Joints that put a TCP that is nearly there at `goal` [m], within 10 µm and 10 µrad.

        `turn`: its rotation matrix there, shape (3, 3). None if they are not found, as beyond the
        reach of the arm. Joint limits do not count. Damped least squares whose damping grows with
        the error (Levenberg-Marquardt), so that far targets and singular poses do not make the
        joints jump and near ones converge fast.
        """
        # axes of the flange there
        x, y, z = (turn if self._tool_turn is None else turn @ self._tool_turn.T).T.tolist()
        angles = list(plain(joints))
        for _ in range(max_steps):
            columns, tcp, flange = self._columns(_turned(angles))
            error = (*minus(goal, tcp), *_turn(flange, (x, y, z)))
            damping = _IK_MIN_DAMPING + _IK_ERROR_DAMPING * sum(part * part for part in error)
            change = _damped_solution(columns, error, damping)
            largest = max(map(abs, change))
            if largest > _IK_MAX_STEP_RAD:
                change = [part * (_IK_MAX_STEP_RAD / largest) for part in change]
            angles = [angle + part for angle, part in zip(angles, change, strict=True)]
            left = max(
                abs(part - sum(map(mul, row, change)))
                for part, row in zip(error, zip(*columns, strict=True), strict=True)
            )
            if left < _FOLLOW_TOLERANCE and largest < _LINEAR_STEP_RAD:
                return tuple(angles)
        return None

    def _columns(self, frames: tuple[Axes, ...]) -> tuple[list[Floats6], Floats3, Axes]:
        """The columns of the Jacobian, the TCP's place and the flange, of an arm's `frames`."""
        tcp = placed(frames[-1], self._tool)
        columns = [(*cross(axis, minus(tcp, at)), *axis) for _, _, axis, at in frames]
        return columns, tcp, frames[-1]


def _damped_solution(columns: list[Floats6], error: Floats6, damping: float) -> list[float]:
    """x that minimises |A x - error|² + damping |x|², A given by its columns.

    By the normal equations and their factors L D Lᵀ, in floats: six unknowns are too few for numpy.
    """
    lower: list[list[float]] = []
    diagonal: list[float] = []
    scaled: list[float] = []  # L⁻¹ Aᵀ error
    for number, column in enumerate(columns):
        row: list[float] = []
        for other in range(number):
            known = sum(map(mul, map(mul, row, lower[other]), diagonal))
            row.append((sum(map(mul, column, columns[other])) - known) / diagonal[other])
        pivot = sum(map(mul, column, column)) + damping
        diagonal.append(pivot - sum(map(mul, map(mul, row, row), diagonal)))
        scaled.append(sum(map(mul, column, error)) - sum(map(mul, row, scaled)))
        lower.append(row)
    solution = [part / pivot for part, pivot in zip(scaled, diagonal, strict=True)]
    for number in range(JOINTS - 1, 0, -1):
        for other, factor in enumerate(lower[number]):
            solution[other] -= factor * solution[number]
    return solution


def _turn(start: Axes, end: Sequence[Sequence[float]]) -> Floats3:
    """Axis times angle [rad] of the rotation from the axes of `start` to those of `end`."""
    sine_x = sine_y = sine_z = trace = 0.0
    for (ax, ay, az), (bx, by, bz) in zip(start[:3], end, strict=True):
        sine_x += ay * bz - az * by
        sine_y += az * bx - ax * bz
        sine_z += ax * by - ay * bx
        trace += ax * bx + ay * by + az * bz
    turn = _vector_of((0.5 * sine_x, 0.5 * sine_y, 0.5 * sine_z), 0.5 * (trace - 1.0))
    return rotation_vector(np.array(end).T @ np.array(start[:3])) if turn is None else turn


def within_joint_limits(joints: Numbers) -> bool:
    """True if every joint is inside its mechanical range."""
    return all(
        low <= angle <= high for angle, (low, high) in zip(joints, JOINT_RANGES, strict=True)
    )


def placed(frame: Axes, place: Floats3) -> Floats3:
    """`place` in `frame`, seen from where the frame is seen."""
    x, y, z, at = frame
    for axis, part in zip((x, y, z), place, strict=True):
        at = plus_times(at, axis, part)
    return at


def rotation_vector(matrix: Matrix) -> Floats3:
    """Axis times angle [rad] of a rotation matrix, shape (3, 3)."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = matrix.tolist()
    sine_axis = 0.5 * (zy - yz), 0.5 * (xz - zx), 0.5 * (yx - xy)
    turn = _vector_of(sine_axis, 0.5 * (xx + yy + zz - 1.0))
    return Rotation.from_matrix(matrix).as_rotvec() if turn is None else turn


def _vector_of(sine_axis: Floats3, cosine: float) -> Floats3 | None:
    """Axis times angle [rad]; None near half a turn, where the axis is lost in the rounding."""
    sine = norm(sine_axis)
    if cosine < 0.0 and sine < 1e-3:
        return None
    return times(sine_axis, math.atan2(sine, cosine) / sine) if sine >= 1e-12 else sine_axis


def rotation_matrix(vector: Numbers) -> Matrix:
    """The rotation matrix of axis times angle [rad] (Rodrigues), shape (3, 3)."""
    x, y, z = map(float, vector)
    angle = norm((x, y, z))
    sine = math.sin(angle) / angle if angle > 1e-12 else 1.0
    half = math.sin(0.5 * angle) / angle if angle > 1e-12 else 0.5
    rest = 2.0 * half * half
    return np.array(
        [
            (1.0 - rest * (y * y + z * z), rest * x * y - sine * z, rest * x * z + sine * y),
            (rest * x * y + sine * z, 1.0 - rest * (x * x + z * z), rest * y * z - sine * x),
            (rest * x * z - sine * y, rest * y * z + sine * x, 1.0 - rest * (x * x + y * y)),
        ]
    )


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


def rpy_from_matrix(matrix: Matrix) -> Floats3:
    """UFACTORY's roll, pitch, yaw [rad] of a rotation matrix, shape (3, 3)."""
    (xx, _, _), (yx, _, _), (zx, zy, zz) = matrix.tolist()
    return math.atan2(zy, zz), math.asin(max(-1.0, min(1.0, -zx))), math.atan2(yx, xx)


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
