"""Estimate of the block's yaw from its outline in the wrist camera.

The outline's support function (how far it reaches in each direction) is compared with that of the
block drawn at every yaw; where it is and how much blur has grown it does not matter.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hw.sim.operator.vision.pinhole import Matrix
from tams_app.records import Vector

_DIRECTIONS = 24
_STEP_RAD = math.radians(2.5)
QUARTER_TURN: Vector = np.arange(-18.0, 18.0) * _STEP_RAD  # all yaws of what has a square outline
HALF_TURN: Vector = np.arange(-36.0, 36.0) * _STEP_RAD  # and of what has an oblong one
_NOT_A_BLOCK_PX = 3.0
_LEAST_SIGMA_RAD = math.radians(0.3)
_PER_CORNER = _DIRECTIONS / 6  # a box's outline has six corners: so many directions err alike
_FITTED = 4  # yaw, place and growth
_ANGLES = np.arange(_DIRECTIONS) * (2.0 * math.pi / _DIRECTIONS)
_NORMALS = np.stack((np.cos(_ANGLES), np.sin(_ANGLES)))
_BASIS = np.linalg.qr(np.column_stack((*_NORMALS, np.ones(_DIRECTIONS))))[0]


@dataclass(frozen=True, slots=True)
class YawFit:
    """Yaw and its standard deviation [rad], and what the best drawing leaves over [px].

    `lasting`: the part of the standard deviation that the next glances at the same image repeat.
    """

    yaw: float
    sigma: float
    lasting: float
    misfit_px: float


def fit_yaw(
    outline: Matrix,
    edge_sigma_px: float,
    draw: Callable[[Vector], Matrix],
    yaws: Vector = QUARTER_TURN,
) -> YawFit | None:
    """The yaw at which the drawing fits best; None when it is no such thing at all.

    `yaws`: those to try [rad], evenly spaced, the first following the last.
    `outline`: the hull seen [px], shape (n, 2); `draw`: corners [px] of the block at each of
    several yaws, shape (yaws, corners, 2).
    """
    seen = (outline @ _NORMALS).max(axis=0)
    drawn = (draw(yaws) @ _NORMALS).max(axis=1)
    gaps = seen - drawn
    gaps = gaps - (gaps @ _BASIS) @ _BASIS.T
    costs = (gaps**2).sum(axis=1)
    best = int(np.argmin(costs))
    misfit_px = math.sqrt(costs[best] / _DIRECTIONS)
    if misfit_px > _NOT_A_BLOCK_PX:
        return None
    # The cost repeats itself, so the neighbours of the first are the second and the last.
    before, after = costs[best - 1], costs[(best + 1) % len(costs)]
    bend = before + after - 2.0 * costs[best]
    if bend <= 0.0:
        return None
    yaw = float(yaws[best] + 0.5 * (before - after) / bend * _STEP_RAD)
    left = max(edge_sigma_px**2, float(costs[best]) / (_DIRECTIONS - _PER_CORNER * _FITTED))
    variance = _PER_CORNER * 2.0 * left / bend * _STEP_RAD**2
    # Half of it is there again in the next glance: measured, sharp, blurred and blocked alike.
    half = math.sqrt(variance / 2.0)
    return YawFit(yaw, math.hypot(half, _LEAST_SIGMA_RAD), half, misfit_px)
