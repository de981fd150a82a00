"""The rig's scene in numbers, for who draws it and who looks at it.

Sizes of gripper, block and container, where things stand, drawn from the seed, and the positions
and lenses of the three cameras. All in the arm's base frame: z up, the table top at z = 0.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tams_app.records import Vector

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
BLOCK_MARKER, CONTAINER_MARKER, GRIPPER_MARKER = 1, 2, 3  # ArUco's numbers, of 4x4_50

WIDTH_PX, HEIGHT_PX = 640, 480
VIEWS = ("eih", "gt", "gs")  # on the wrist, above the table, beside it


@dataclass(frozen=True, slots=True)
class Viewpoint:
    """A camera at `place` [m]; `fovy_deg` is vertical.

    axes: the image's right, down and forward axes as columns, shape (3, 3).
    """

    place: tuple[float, float, float]
    axes: NDArray[np.float64]
    fovy_deg: float


def _looking_at(
    place: tuple[float, float, float], target: tuple[float, float, float], fovy_deg: float
) -> Viewpoint:
    """From `place` to `target` in the base frame.

    The world stands upright in the image; from above, up in the image is +x.
    """
    forward = np.subtract(target, place)
    forward /= np.linalg.norm(forward)
    steep = abs(forward[2]) > math.sin(math.radians(60))
    right = np.cross(forward, (1.0, 0.0, 0.0) if steep else (0.0, 0.0, 1.0))
    right /= np.linalg.norm(right)
    axes = np.column_stack((right, np.cross(forward, right), forward))
    return Viewpoint(place, axes, fovy_deg)


# Both see the whole work area (block, container, and the gripper at travelling height) and little
# beside it, so that the 12 mm block is 13 pixels wide in them.
FIXED_VIEWPOINTS = {
    "gt": _looking_at((0.75, 0.0, 0.82), (0.325, 0.0, 0.02), 29.0),
    "gs": _looking_at((0.86, -0.60, 0.44), (0.30, -0.005, 0.085), 27.0),
}


def _tilted(place: tuple[float, float, float], tilt_deg: float, fovy_deg: float) -> Viewpoint:
    """In the flange's frame, tilted about its y axis."""
    sine, cosine = math.sin(math.radians(tilt_deg)), math.cos(math.radians(tilt_deg))
    down: Vector = np.array([-cosine, 0.0, sine])
    right: Vector = np.array([0.0, 1.0, 0.0])
    return Viewpoint(place, np.column_stack((right, down, np.cross(right, down))), fovy_deg)


# On the side of the base when the gripper points down; it sees the fingers and what is between.
WRIST_VIEWPOINT = _tilted((-0.068, 0.0, 0.024), 38.0, 62.0)
