"""Sizes of gripper, block and container, and where things stand, drawn from the seed.

All in the arm's base frame: z up, the table top at z = 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

BLOCK_EDGE_M = 0.012  # the gripper opens 16 mm
BLOCK_HEIGHT_M = 0.020
CONTAINER_INNER_M = 0.090  # square
CONTAINER_WALL_M = 0.003
CONTAINER_HEIGHT_M = 0.030

_RADIUS_M = (0.335, 0.385)  # clear of the wrist singularity, well within reach
_BLOCK_AZIMUTH_DEG = (-35.0, -10.0)
_CONTAINER_AZIMUTH_DEG = (15.0, 35.0)
_YAW_DEG = (-30.0, 30.0)


@dataclass(frozen=True, slots=True)
class Placement:
    """A position on the table [m] and a yaw [rad]."""

    x: float
    y: float
    yaw: float


@dataclass(frozen=True, slots=True)
class Layout:
    """The block and the container of one trial."""

    block: Placement
    container: Placement


def draw_layout(seed: int) -> Layout:
    """The layout of trial `seed`: the same seed always gives the same scene."""
    random = np.random.default_rng([seed, 0x5CE7E])

    def place(azimuth_deg: tuple[float, float], yaw_deg: tuple[float, float]) -> Placement:
        radius = random.uniform(*_RADIUS_M)
        azimuth = math.radians(random.uniform(*azimuth_deg))
        yaw = math.radians(random.uniform(*yaw_deg))
        return Placement(radius * math.cos(azimuth), radius * math.sin(azimuth), yaw)

    return Layout(place(_BLOCK_AZIMUTH_DEG, _YAW_DEG), place(_CONTAINER_AZIMUTH_DEG, (-10.0, 10.0)))


TCP_OFFSET_M = 0.082  # from the flange along its z
FINGER_TRAVEL_M = 0.008  # each; 16 mm between the pads when open

# Centre and half size.
HOUSING = ((0.0, 0.0, 0.027), (0.018, 0.034, 0.021))
PLATE = ((0.0, 0.0, 0.050), (0.0125, 0.032, 0.003))

# Half sizes: of each finger the green pad and the dark clip behind it; of the housing's markers,
# whose edge includes the quiet zone.
PAD_HALF = (0.0065, 0.0040, 0.011)
CLIP_HALF = (0.0068, 0.0012, 0.006)
MARKER_HALF_M = 0.0165
