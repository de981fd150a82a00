"""The rotation that takes measured directions to prompted ones, and how far it may be wrong."""

from __future__ import annotations

import math

import numpy as np
from numpy.typing import NDArray
from scipy import stats

Matrix = NDArray[np.float64]

CONFIDENCE = 0.95


def kabsch(measured: Matrix, wanted: Matrix) -> Matrix:
    """The proper rotation R, shape (3, 3), that minimises Σ|R m - w|² over rows m, w.

    Kabsch (1976), by singular values; never a mirror (Umeyama 1991).
    """
    u, _, vt = np.linalg.svd(wanted.T @ measured)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    return np.asarray(u @ flip @ vt)


def angles_deg(rotation: Matrix, measured: Matrix, wanted: Matrix) -> NDArray[np.float64]:
    """Between each R m and w [deg], shape (n,); rows are unit vectors."""
    turned = measured @ rotation.T
    sine = np.linalg.norm(np.cross(turned, wanted), axis=1)
    cosine = (turned * wanted).sum(axis=1)
    return np.asarray(np.degrees(np.arctan2(sine, cosine)))


def turn_deg(one: Matrix, other: Matrix) -> float:
    """The angle between two rotations [deg]."""
    relative = one @ other.T
    skew = relative - relative.T
    sine = math.sqrt(float((skew**2).sum()) / 8)
    return math.degrees(math.atan2(sine, (float(np.trace(relative)) - 1) / 2))


def bound_rad(information: Matrix, variance: float, freedom: int) -> float:
    """How far the rotation may be off [rad], with 95 % confidence, about its worst axis.

    `information`: Σ(I - d dᵀ) over unit directions (Shuster and Oh 1981), or Σ(|q|² I - q qᵀ) over
    points. `variance`: of one component of a residual, estimated with `freedom` degrees; its own
    uncertainty is counted by the F distribution. Infinite if something is not determined.
    """
    weakest = float(np.linalg.eigvalsh(information)[0])
    if weakest <= 1e-12 or freedom < 1:
        return math.inf
    spread = 3 * float(stats.f.ppf(CONFIDENCE, 3, freedom))
    return math.sqrt(spread * variance / weakest)


def condition(directions: Matrix) -> float:
    """Largest over smallest singular value of unit rows: 1 when they span space evenly."""
    values = np.linalg.svd(directions, compute_uv=False)
    return float(values[0] / values[2]) if values[2] > 1e-9 else math.inf
