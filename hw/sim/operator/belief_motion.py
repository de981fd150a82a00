"""What a moving tool and passing time make uncertain: the noise between two glances."""

from __future__ import annotations

import math

import numpy as np

from hw.sim.operator.belief_state import BLOCK, BLOCK_YAW, CONTAINER, SIZE, TOOL, TOOL_YAW, TURN
from hw.sim.operator.vision.pinhole import Matrix
from tams_app.records import Vector

_ARM_UNCERTAIN = 0.25  # of the motion asked for: limits, clutch, a misjudged direction
_DRIFT_M = 0.002  # in a second, unseen
_TURN_UNCERTAIN = 0.15  # of the turn asked for
_TILTS = 0.06  # of it: a turn about an axis that is not quite the vertical
_DRIFT_RAD = 0.01
_BLOCK_TURN_UNCERTAIN = 0.3  # of the turn asked for, near the fingers
_SLIPS = 0.10  # of the motion of what is carried
_REST_DRIFT_M = 0.001
_LEAST_DOUBT = 0.06  # variance of whether it comes along


def motion_noise(moved: Vector, turned: Vector, seconds: float, along: float, near: bool) -> Matrix:
    """Covariance, shape (SIZE, SIZE), that motion [m], [rad] asked of the tool adds.

    `along`: the part of it that the block shares; `near`: whether it may be in the fingers. What
    makes the tool uncertain makes what it carries uncertain with it.
    """
    path, turn, drift = _size(moved), _size(turned), math.sqrt(seconds)
    noise = np.zeros(SIZE)
    noise[TOOL] = (_ARM_UNCERTAIN * path) ** 2 + (_DRIFT_M * drift) ** 2
    noise[TURN] = (_TILTS * turn) ** 2 + (_DRIFT_RAD * drift) ** 2
    noise[TOOL_YAW] += (_TURN_UNCERTAIN * turn) ** 2
    noise[BLOCK] = (_REST_DRIFT_M * drift) ** 2 + along**2 * noise[TOOL]
    noise[BLOCK_YAW] = (_DRIFT_RAD * drift) ** 2
    noise[CONTAINER] = (_REST_DRIFT_M * drift) ** 2
    if near:
        doubt = max(_LEAST_DOUBT, along * (1.0 - along))
        noise[BLOCK] += doubt * path**2 + (_SLIPS * path) ** 2
        noise[BLOCK_YAW] += (_BLOCK_TURN_UNCERTAIN * turn) ** 2
    covariance = np.diag(noise)
    covariance[TOOL, BLOCK] = covariance[BLOCK, TOOL] = along * np.diag(noise[TOOL])
    return covariance


def _size(vector: Vector) -> float:
    return math.sqrt(vector @ vector)
