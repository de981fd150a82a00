"""Views in pixels: cameras without distortion, and what a glance at their images detects."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from hw.sim.layout import FIXED_VIEWPOINTS, HEIGHT_PX, TCP_OFFSET_M, WIDTH_PX, WRIST_VIEWPOINT
from tams_app.records import Vector, focal_length_px

Matrix = NDArray[np.float64]
_NEAREST_M = 0.01
_CENTRE: Vector = np.array(((WIDTH_PX - 1) / 2, (HEIGHT_PX - 1) / 2))  # [px]


@dataclass(frozen=True, slots=True)
class Pinhole:
    """A camera at `place` [m] with the image's right, down, forward `axes` as columns."""

    place: Vector
    axes: Matrix
    focal_px: float

    @staticmethod
    def of(place: Vector, axes: Matrix, fovy_deg: float) -> Pinhole:
        """From the vertical field of view of an image of 640 by 480."""
        return Pinhole(np.asarray(place, float), axes, focal_length_px(fovy_deg, HEIGHT_PX))

    def depths(self, points: Matrix) -> Vector:
        """Distance along the optical axis [m], shape (n,), of `points`, shape (n, 3)."""
        return np.asarray((points - self.place) @ self.axes[:, 2])

    def project(self, points: Matrix) -> Matrix:
        """Pixels, shape (n, 2), of `points` [m], shape (n, 3); pixel centres are whole numbers."""
        seen = (points - self.place) @ self.axes
        depth = np.maximum(seen[:, 2:], _NEAREST_M)
        return np.asarray(self.focal_px * seen[:, :2] / depth + _CENTRE)

    def jacobian(self, point: Vector) -> Matrix:
        """The derivative of the pixel by the point [px/m], shape (2, 3)."""
        seen = (point - self.place) @ self.axes
        depth = max(float(seen[2]), _NEAREST_M)
        flat = np.array([[1.0, 0.0, -seen[0] / depth], [0.0, 1.0, -seen[1] / depth]])
        return np.asarray(self.focal_px / depth * flat @ self.axes.T)

    def ray_at_height(self, pixel: Vector, height_m: float) -> Vector:
        """The point at `height_m` over the table that `pixel` shows [m], shape (3,)."""
        ray = self.axes @ np.array([*((pixel - _CENTRE) / self.focal_px), 1.0])
        return np.asarray(self.place + ray * ((height_m - self.place[2]) / ray[2]))


def fixed_cameras() -> dict[str, Pinhole]:
    """The cameras beside and above the table, in the base frame."""
    return {
        view: Pinhole.of(np.array(seen.place), seen.axes, seen.fovy_deg)
        for view, seen in FIXED_VIEWPOINTS.items()
    }


def wrist_cameras() -> dict[str, Pinhole]:
    """The eye-in-hand camera in the tool's frame (origin: TCP)."""
    seen = WRIST_VIEWPOINT
    place = np.array(seen.place) - (0.0, 0.0, TCP_OFFSET_M)
    return {"eih": Pinhole.of(place, seen.axes, seen.fovy_deg)}


class Thing(StrEnum):
    """A thing that the operator looks for."""

    TOOL = "tool"
    BLOCK = "block"
    CONTAINER = "container"


class Cue(StrEnum):
    """The sign that a thing was recognised by; each errs in its own way."""

    COLOUR = "colour"
    MARKER = "marker"
    MARKER_AHEAD = "marker ahead"  # the gripper's three
    MARKER_LEFT = "marker left"
    MARKER_RIGHT = "marker right"


@dataclass(frozen=True, slots=True)
class Sighting:
    """Points of a thing found in a view.

    `pixels`, shape (n, 2), show `points`, shape (n, 3) [m]: for the tool in its own frame, for
    block and container away from their centres along the base frame's axes.

    Standard deviations: `sigma_px` of each coordinate by itself, anew in every glance, and what
    the next glances at the same image repeat: `lasting_px` of a shift that all points share, and
    `warp_px` of each one's shift by a stretch and shear of the whole (blur draws a marker's corners
    inwards). Looking again helps against the first only.
    """

    view: str
    thing: Thing
    pixels: Matrix
    points: Matrix
    sigma_px: float
    lasting_px: float = 0.0
    warp_px: float = 0.0
    cue: Cue = Cue.COLOUR


@dataclass(frozen=True, slots=True)
class HeadingSighting:
    """The block's yaw against the tool's as the wrist camera shows it [rad].

    Modulo a quarter turn where it stands, of its long side and modulo half a turn where it lies.
    `lasting` as a sighting's `lasting_px`.
    """

    view: str
    heading: float
    sigma: float
    lying: bool = False
    lasting: float = 0.0


@dataclass(frozen=True, slots=True)
class Glance:
    """All that one look at the images yields; `fingers_opening` [m] None when not made out."""

    sightings: tuple[Sighting, ...]
    headings: tuple[HeadingSighting, ...]
    fingers_opening: float | None
