"""Poses and velocities."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from tams_app.rotation import Rotation
from tams_app.vectors import ZERO, Floats3

Vector: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Pose:
    """Position [m], shape (3,), and rotation of a frame in its parent frame."""

    position: Vector
    rotation: Rotation


@dataclass(frozen=True, slots=True)
class Twist:
    """Linear [m/s] and angular [rad/s] velocity in the arm's base frame."""

    linear: Floats3
    angular: Floats3

    @staticmethod
    def zero() -> Twist:
        return Twist(ZERO, ZERO)

    @property
    def is_zero(self) -> bool:
        return not (any(self.linear) or any(self.angular))
