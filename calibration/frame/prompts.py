"""What the person is asked to do next."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from calibration.frame.stroke import AXES
from tams_app.records import Vector


@dataclass(frozen=True, slots=True)
class Move:
    """Hold the trigger and move the hand along one of the robot's axes, `sign` 1 or -1."""

    axis: int
    sign: int = 1

    @property
    def name(self) -> str:
        return f"{'+' if self.sign > 0 else '−'}{AXES[self.axis]}"

    @property
    def direction(self) -> Vector:
        """Unit, in the arm's base frame, shape (3,)."""
        return np.asarray(self.sign * np.eye(3)[self.axis])


@dataclass(frozen=True, slots=True, eq=False)
class Reach:
    """Touch one of the robot's points [m], shape (3,), and squeeze the trigger."""

    robot: Vector
    number: int  # from 1


@dataclass(frozen=True, slots=True)
class Press:
    """Press and let go one part of the controller, of `hw.openvr.components.ROLES`."""

    role: str


Prompt: TypeAlias = Move | Reach | Press
SIX_WAYS = tuple(Move(axis, sign) for axis in range(3) for sign in (1, -1))
