"""Poses and velocities."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, TypeAlias

import numpy as np
from numpy.typing import NDArray

from tams_app.rotation import Rotation
from tams_app.vectors import ZERO, Floats3

Vector: TypeAlias = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Pose:
    """A frame in its parent frame."""

    position: Annotated[Vector, "x, y, z [m]"]
    rotation: Annotated[Rotation, "quaternion x, y, z, w"]


@dataclass(frozen=True, slots=True)
class Twist:
    """A velocity in the arm's base frame."""

    linear: Annotated[Floats3, "velocity x, y, z [m/s]"]
    angular: Annotated[Floats3, "angular velocity x, y, z [rad/s]"]

    @staticmethod
    def zero() -> Twist:
        return Twist(ZERO, ZERO)

    @property
    def is_zero(self) -> bool:
        return not (any(self.linear) or any(self.angular))
