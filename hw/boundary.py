"""The box that the arm's controller itself refuses to leave: a second fence around our own."""

from __future__ import annotations

import math

from hw.arm import TcpBoundary
from hw.arms import arm_kind
from tams_app.config import ArmConfig, LimitsConfig


def session_boundary(arm: ArmConfig, limits: LimitsConfig) -> TcpBoundary:
    """The workspace's box and `arm.boundary_margin_mm` around it.

    The margin keeps the two apart: the limits stop the arm smoothly at the box, the controller
    stops it with an error if it leaves the box all the same.
    """
    low_z = max(limits.box_min_mm[2], limits.floor_mm)
    return _around((*limits.box_min_mm[:2], low_z), limits.box_max_mm, arm.boundary_margin_mm)


def reach_boundary(arm: ArmConfig, limits: LimitsConfig) -> TcpBoundary:
    """All that the arm reaches above the floor, for the trajectory to the ready pose.

    That may begin anywhere above the table: the factory's home of an arm lies outside many a
    workspace, and the controller, with the session's boundary set, would refuse to move from there.
    """
    most = arm_kind(arm.model).limits
    reach_mm = most.stretched_mm + math.hypot(*arm.tcp_offset_mm_deg[:3])
    floor_mm = min(limits.floor_mm, limits.box_min_mm[2])
    low = (-reach_mm, -reach_mm, floor_mm)
    high = (reach_mm, reach_mm, most.shoulder_mm + reach_mm)
    return _around(low, high, arm.boundary_margin_mm)


def _around(
    low: tuple[float, float, float], high: tuple[float, float, float], margin_mm: float
) -> TcpBoundary:
    """Whole millimetres, away from the middle."""
    lower = [math.floor(edge - margin_mm) for edge in low]
    upper = [math.ceil(edge + margin_mm) for edge in high]
    return TcpBoundary((lower[0], lower[1], lower[2]), (upper[0], upper[1], upper[2]))
