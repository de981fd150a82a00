"""Positions and lenses of the rig's three cameras, for who draws the scene and who looks at it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tams_app.records import Vector

WIDTH_PX, HEIGHT_PX = 640, 480
VIEWS = ("eih", "gt", "gs")  # on the wrist, above the table, beside it


@dataclass(frozen=True, slots=True)
class FixedViewpoint:
    """A camera at `place` that looks at `target` [m], base frame; `fovy_deg` is vertical."""

    place: tuple[float, float, float]
    target: tuple[float, float, float]
    fovy_deg: float

    def axes(self) -> NDArray[np.float64]:
        """The image's right, down and forward axes as columns, shape (3, 3), base frame.

        The world stands upright in the image; from above, up in the image is +x.
        """
        forward = np.subtract(self.target, self.place)
        forward /= np.linalg.norm(forward)
        steep = abs(forward[2]) > math.sin(math.radians(60))
        right = np.cross(forward, (1.0, 0.0, 0.0) if steep else (0.0, 0.0, 1.0))
        right /= np.linalg.norm(right)
        return np.column_stack((right, np.cross(forward, right), forward))


# Both see the whole work area (block, container, and the gripper at travelling height) and little
# beside it, so that the 12 mm block is 13 pixels wide in them.
FIXED_VIEWPOINTS = {
    "gt": FixedViewpoint((0.75, 0.0, 0.82), (0.325, 0.0, 0.02), 29.0),
    "gs": FixedViewpoint((0.86, -0.60, 0.44), (0.30, -0.005, 0.085), 27.0),
}


@dataclass(frozen=True, slots=True)
class WristViewpoint:
    """The eye-in-hand camera in the flange's frame [m], tilted about its y axis."""

    place: tuple[float, float, float]
    tilt_deg: float
    fovy_deg: float

    def axes(self) -> NDArray[np.float64]:
        """The image's right, down and forward axes as columns, shape (3, 3), flange frame."""
        sine, cosine = math.sin(math.radians(self.tilt_deg)), math.cos(math.radians(self.tilt_deg))
        down: Vector = np.array([-cosine, 0.0, sine])
        right: Vector = np.array([0.0, 1.0, 0.0])
        return np.column_stack((right, down, np.cross(right, down)))


# On the side of the base when the gripper points down; it sees the fingers and what is between.
WRIST_VIEWPOINT = WristViewpoint((-0.068, 0.0, 0.024), 38.0, 62.0)
