"""The box that the arm's controller itself refuses to leave: a second fence around our own."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tams_app.config import ArmConfig, LimitsConfig
from tams_app.records import Vector

# The Lite 6's kinematics (FINDINGS 8): height of the shoulder, and from there to the flange of the
# stretched arm: 200, then 87 and 227.6 at a right angle, then 61.5.
_SHOULDER_MM = 243.3
_STRETCHED_MM = 200.0 + math.hypot(87.0, 227.6) + 61.5
_FARTHEST_MM = 9999  # registers 52 and 53 hold more; nothing of the arm gets there


@dataclass(frozen=True, slots=True)
class TcpBoundary:
    """Where the TCP may be, in the arm's base frame, in whole millimetres: x, y, z."""

    lower_mm: tuple[int, int, int]
    upper_mm: tuple[int, int, int]

    @property
    def on_the_wire(self) -> list[int]:
        """As registers 52 and 53 order it: x max, x min, y max, y min, z max, z min."""
        pairs = zip(self.upper_mm, self.lower_mm, strict=True)
        return [edge for pair in pairs for edge in pair]

    def contains(self, position: Vector) -> bool:
        """Whether `position` [m], shape (3,), is inside."""
        return all(
            low <= value * 1000.0 <= high
            for value, low, high in zip(position, self.lower_mm, self.upper_mm, strict=True)
        )


def session_boundary(arm: ArmConfig, limits: LimitsConfig) -> TcpBoundary:
    """The workspace's box and `arm.boundary_margin_mm` around it.

    The margin keeps the two apart: the limits stop the arm smoothly at the box, the controller
    stops it with error C35 if it leaves the box all the same.
    """
    low_z = max(limits.box_min_mm[2], limits.floor_mm)
    return _around((*limits.box_min_mm[:2], low_z), limits.box_max_mm, arm.boundary_margin_mm)


def reach_boundary(arm: ArmConfig, limits: LimitsConfig) -> TcpBoundary:
    """For the way to the ready pose, which may begin anywhere above the table.

    The factory's home has its TCP 200 mm from the base axis, outside many a workspace: the
    controller, with the session's boundary set, would refuse to move from there.
    """
    reach_mm = _STRETCHED_MM + math.hypot(*arm.tcp_offset_mm_deg[:3])
    floor_mm = min(limits.floor_mm, limits.box_min_mm[2])
    low = (-reach_mm, -reach_mm, floor_mm)
    return _around(low, (reach_mm, reach_mm, _SHOULDER_MM + reach_mm), arm.boundary_margin_mm)


def _around(
    low: tuple[float, float, float], high: tuple[float, float, float], margin_mm: float
) -> TcpBoundary:
    """Whole millimetres, away from the middle."""
    lower = [max(math.floor(edge - margin_mm), -_FARTHEST_MM) for edge in low]
    upper = [min(math.ceil(edge + margin_mm), _FARTHEST_MM) for edge in high]
    return TcpBoundary((lower[0], lower[1], lower[2]), (upper[0], upper[1], upper[2]))
