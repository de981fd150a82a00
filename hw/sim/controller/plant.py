"""What the controller model drives: joints and gripper, ideal or simulated."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from tams_app.records import Vector


class GripperDrive(Enum):
    """The state of the two tool outputs that drive the Lite 6 gripper."""

    OFF = 0
    OPEN = 1
    CLOSE = 2


@dataclass(frozen=True, slots=True)
class PlantState:
    """Measured joints [rad], shape (6,), and whether a joint met more force than it may."""

    joints: Vector
    collision: bool


class Plant(Protocol):
    """Follows joint targets; the controller model calls `step` once per cycle."""

    def step(self, joints_target: Vector, gripper: GripperDrive, duration_ns: int) -> PlantState:
        """Advance by `duration_ns` towards `joints_target` [rad], shape (6,)."""


class IdealPlant:
    """Joints that are where they should be, at once."""

    def step(self, joints_target: Vector, gripper: GripperDrive, duration_ns: int) -> PlantState:
        return PlantState(joints_target.copy(), collision=False)
