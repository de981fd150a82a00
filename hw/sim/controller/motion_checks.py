"""What the controller checks in every cycle of a motion before the joints get it."""

from __future__ import annotations

import math

import numpy as np

from hw.arm import TcpBoundary
from hw.lite6.codes import ErrorCode
from hw.lite6.kinematics import (
    BASE_TO_SHOULDER_M,
    JOINT_SPEED_LIMITS,
    Matrix,
    link_frames,
    within_joint_limits,
)
from hw.sim.controller.errors import MotionError
from hw.sim.controller.joint_servo import CYCLE_S
from tams_app.records import Vector

# The base column and the last links as capsules: half their widths together. At zero joints, a
# pose the real arm allows, the flange is 87 mm from the column's axis.
KEEP_OUT_RADIUS_M = 0.075

_WRIST_LINK = 4
_SPEED_MARGIN = 1.0 + 1e-6  # a servo at its limit is not above it


def check_motion(
    joints: Vector,
    following: Vector,
    tcp_in_flange: Matrix,
    fence: TcpBoundary | None,
    self_collision: bool,
) -> None:
    """MotionError if the step from `joints` to `following` within a cycle is not allowed."""
    if not within_joint_limits(following):
        raise MotionError(ErrorCode.JOINT_LIMIT)
    speeds = np.abs(following - joints) / CYCLE_S
    if (speeds > JOINT_SPEED_LIMITS * _SPEED_MARGIN).any():
        raise MotionError(ErrorCode.JOINT_OVERSPEED)
    frames = link_frames(following)
    tcp = (frames[-1] @ tcp_in_flange)[:3, 3]
    if fence is not None and not fence.contains(tcp):
        raise MotionError(ErrorCode.BOUNDARY)
    if self_collision and _hits_base(frames[_WRIST_LINK][:3, 3], frames[-1][:3, 3], tcp):
        raise MotionError(ErrorCode.SELF_COLLISION)


def _hits_base(wrist: Vector, flange: Vector, tcp: Vector) -> bool:
    """Whether the line through wrist, flange and TCP comes too near the base column."""
    points = (wrist, 0.5 * (wrist + flange), flange, 0.5 * (flange + tcp), tcp)
    return any(_distance_to_column(*point.tolist()) < KEEP_OUT_RADIUS_M for point in points)


def _distance_to_column(x: float, y: float, z: float) -> float:
    return math.hypot(x, y, max(z - BASE_TO_SHOULDER_M, 0.0))
