"""A camera without distortion: from points to pixels, and how pixels move with points."""

from __future__ import annotations

from dataclasses import dataclass

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
        view: Pinhole.of(np.array(seen.place), seen.axes(), seen.fovy_deg)
        for view, seen in FIXED_VIEWPOINTS.items()
    }


def wrist_camera() -> Pinhole:
    """The eye-in-hand camera in the tool's frame (origin: TCP)."""
    seen = WRIST_VIEWPOINT
    place = np.array(seen.place) - (0.0, 0.0, TCP_OFFSET_M)
    return Pinhole.of(place, seen.axes(), seen.fovy_deg)
