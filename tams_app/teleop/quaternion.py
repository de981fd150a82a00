"""Rotations inside a tick, as unit quaternions (x, y, z, w) of plain floats.

scipy's Rotation is the type between packages; it costs 8–14 µs for each product or inverse
(measured, scipy 1.17), and one tick needs a dozen. These cost 1 µs each.
"""

from __future__ import annotations

import math
from typing import TypeAlias

import numpy as np
from scipy.spatial.transform import Rotation

from tams_app.records import Vector

Quaternion: TypeAlias = tuple[float, float, float, float]

IDENTITY: Quaternion = (0.0, 0.0, 0.0, 1.0)
_SMALL_RAD = 1e-9


def of_rotation(rotation: Rotation) -> Quaternion:
    x, y, z, w = rotation.as_quat().tolist()
    return x, y, z, w


def to_rotation(quaternion: Quaternion) -> Rotation:
    return Rotation.from_quat(quaternion)


def inverse(q: Quaternion) -> Quaternion:
    return -q[0], -q[1], -q[2], q[3]


def product(second: Quaternion, first: Quaternion) -> Quaternion:
    """The rotation `first`, then `second`; normalised, so that chains do not drift."""
    ax, ay, az, aw = second
    bx, by, bz, bw = first
    x = aw * bx + ax * bw + ay * bz - az * by
    y = aw * by - ax * bz + ay * bw + az * bx
    z = aw * bz + ax * by - ay * bx + az * bw
    w = aw * bw - ax * bx - ay * by - az * bz
    size = math.sqrt(x * x + y * y + z * z + w * w)
    return x / size, y / size, z / size, w / size


def turned(start: Quaternion, turn: Vector) -> Quaternion:
    """`start` followed by the rotation vector `turn` [rad] of the base frame."""
    x, y, z = turn.tolist()
    angle = math.sqrt(x * x + y * y + z * z)
    if angle == 0.0:
        return start
    scale = math.sin(angle / 2.0) / angle if angle > _SMALL_RAD else 0.5
    return product((x * scale, y * scale, z * scale, math.cos(angle / 2.0)), start)


def turn_between(start: Quaternion, end: Quaternion) -> Vector:
    """The rotation vector [rad], base frame, at most π long, from `start` to `end`."""
    if start == end:
        return np.zeros(3)
    x, y, z, w = product(end, inverse(start))
    if w < 0.0:
        x, y, z, w = -x, -y, -z, -w
    size = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 * math.atan2(size, w) / size if size > _SMALL_RAD else 2.0
    return np.array([x * scale, y * scale, z * scale])
