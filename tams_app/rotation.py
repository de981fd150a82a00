"""One rotation as a unit quaternion of plain floats.

scipy's `Rotation` is made for arrays of them: 8–14 µs an operation, of which a control tick needs
dozens. Here an operation takes about 1 µs.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tams_app.vectors import ZERO, Floats3, Numbers

_SMALL_RAD = 1e-9


class Rotation(NamedTuple):
    """A rotation (x, y, z, w), w the cosine of half the angle; its methods are named as scipy's."""

    x: float
    y: float
    z: float
    w: float

    @staticmethod
    def identity() -> Rotation:
        return Rotation(0.0, 0.0, 0.0, 1.0)

    @staticmethod
    def from_quat(quaternion: Numbers) -> Rotation:
        """From x, y, z, w of any length but 0 (ValueError)."""
        x, y, z, w = map(float, quaternion)
        size = math.sqrt(x * x + y * y + z * z + w * w)
        if size == 0.0:
            raise ValueError("a quaternion of length 0 is no rotation")
        return Rotation(x / size, y / size, z / size, w / size)

    @staticmethod
    def from_rotvec(vector: Numbers) -> Rotation:
        """From axis times angle [rad], shape (3,)."""
        x, y, z = map(float, vector)
        angle = math.sqrt(x * x + y * y + z * z)
        scale = math.sin(angle / 2.0) / angle if angle > _SMALL_RAD else 0.5
        return Rotation(x * scale, y * scale, z * scale, math.cos(angle / 2.0))

    @staticmethod
    def from_matrix(matrix: NDArray[np.float64] | Sequence[Sequence[float]]) -> Rotation:
        """From a rotation matrix, shape (3, 3), by the largest of the four parts."""
        (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = np.asarray(matrix, dtype=np.float64).tolist()
        largest = max(xx, yy, zz, xx + yy + zz)
        if largest == xx + yy + zz:
            parts = (zy - yz, xz - zx, yx - xy, 1.0 + largest)
        elif largest == xx:
            parts = (1.0 + xx - yy - zz, xy + yx, xz + zx, zy - yz)
        elif largest == yy:
            parts = (xy + yx, 1.0 + yy - xx - zz, yz + zy, xz - zx)
        else:
            parts = (xz + zx, yz + zy, 1.0 + zz - xx - yy, yx - xy)
        return Rotation.from_quat(parts)

    def __mul__(self, first: Rotation) -> Rotation:  # type: ignore[override]  # not a tuple's
        """The rotation `first`, then this one; normalised, so that chains do not drift."""
        ax, ay, az, aw = self
        bx, by, bz, bw = first
        x = aw * bx + ax * bw + ay * bz - az * by
        y = aw * by - ax * bz + ay * bw + az * bx
        z = aw * bz + ax * by - ay * bx + az * bw
        w = aw * bw - ax * bx - ay * by - az * bz
        size = math.sqrt(x * x + y * y + z * z + w * w)
        return Rotation(x / size, y / size, z / size, w / size)

    def inv(self) -> Rotation:
        return Rotation(-self.x, -self.y, -self.z, self.w)

    def magnitude(self) -> float:
        """The angle [rad], 0 to π."""
        x, y, z, w = self
        return 2.0 * math.atan2(math.sqrt(x * x + y * y + z * z), abs(w))

    def as_matrix(self) -> NDArray[np.float64]:
        """Shape (3, 3)."""
        x, y, z, w = self
        return np.array(
            [
                [1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - z * w), 2.0 * (x * z + y * w)],
                [2.0 * (x * y + z * w), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - x * w)],
                [2.0 * (x * z - y * w), 2.0 * (y * z + x * w), 1.0 - 2.0 * (x * x + y * y)],
            ]
        )

    def as_rotvec(self) -> Floats3:
        """Axis times angle [rad], at most π long."""
        x, y, z, w = self if self.w >= 0.0 else (-self.x, -self.y, -self.z, -self.w)
        size = math.sqrt(x * x + y * y + z * z)
        scale = 2.0 * math.atan2(size, w) / size if size > _SMALL_RAD else 2.0
        return x * scale, y * scale, z * scale

    def apply(self, vectors: Numbers) -> NDArray[np.float64]:
        """`vectors`, shape (3,) or (n, 3), turned."""
        turned: NDArray[np.float64] = np.asarray(vectors, dtype=np.float64) @ self.as_matrix().T
        return turned

    def turned(self, turn: Numbers) -> Rotation:
        """This rotation followed by the rotation vector `turn` [rad] of the parent frame."""
        x, y, z = turn
        return self if x == y == z == 0.0 else Rotation.from_rotvec(turn) * self

    def turn_to(self, end: Rotation) -> Floats3:
        """The rotation vector [rad], parent frame, that leads from here to `end`."""
        return ZERO if self == end else (end * self.inv()).as_rotvec()
