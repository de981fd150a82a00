"""Visibility of the simulated world in its cameras, decided without drawing it.

A geom that lies wholly beyond a plane which bounds the camera's view adds no pixel to the image,
nor does one below a slab that fills the image. Bounding boxes decide, so some geoms are drawn for
nothing and none is missing.
"""

from __future__ import annotations

import math
from itertools import product

import mujoco
import numpy as np
from numpy.typing import NDArray

from hw.sim.layout import HEIGHT_PX, WIDTH_PX

_SLABS = ("mat", "table")  # boxes along the axes of the world, the upper one first
_WIDER = 1.001  # field of view searched / that of the lens
_MARGIN_M = 0.001
_BELOW_M = 0.0005  # a slab's top: what is further down is hidden; the table is 1.5 mm below the mat
_LEAST_HEIGHT_M = 0.02  # above a slab: nearer, the near plane might cut it
_LEAST_SLOPE = 0.01  # of a ray that meets a slab
_MARGIN_PX = 2
_FACES = np.concatenate((np.eye(3), -np.eye(3)))  # of a box along the axes, inwards
_CORNERS = np.array(list(product((-1.0, 1.0), repeat=3)))

Rows = NDArray[np.float64]
Geoms = NDArray[np.bool_]


class Visibility:
    """The parts visible to the cameras of `model`, in the pose that `data` had at `update`.

    Geoms are arrays of flags, shape (ngeom,); cameras are their numbers in the model.
    """

    def __init__(self, model: mujoco.MjModel, data: mujoco.MjData) -> None:
        self._centres = data.geom_xpos
        self._axes = data.geom_xmat.reshape(-1, 3, 3)
        self._places, self._turns = data.cam_xpos, data.cam_xmat.reshape(-1, 3, 3)
        self._sizes = model.geom_aabb[:, 3:, None].copy()
        planes = model.geom_type == mujoco.mjtGeom.mjGEOM_PLANE
        self._sizes[planes, :, 0] = model.geom_size[planes] * (1, 1, 0)
        self._slabs = [model.geom(name).id for name in _SLABS]
        self._lenses = [_lens(float(fovy)) for fovy in np.radians(model.cam_fovy)]
        self.update()

    def update(self) -> None:
        """Take in the pose: boxes around the geoms, along the axes of the world."""
        self._halves: Rows = (np.abs(self._axes) @ self._sizes)[:, :, 0]

    def seen(self, camera: int) -> Geoms:
        """The geoms that may be in the image of `camera`."""
        place, turn = self._places[camera], self._turns[camera]
        right, up = self._lenses[camera]
        inwards = np.array([(-1, 0, -right), (1, 0, -right), (0, -1, -up), (0, 1, -up), (0, 0, -1)])
        normals = inwards @ turn.T
        least = normals @ place - _MARGIN_M
        above = self._above_slab(camera)
        if above is not None:
            normals, least = np.concatenate((normals, _FACES)), np.concatenate((least, above))
        reach = self._centres @ normals.T + self._halves @ np.abs(normals.T)
        seen: Geoms = (reach > least).all(axis=1)
        return seen

    def rectangle(self, camera: int, geoms: Geoms) -> tuple[int, int, int, int]:
        """Left, bottom, width and height [px] of all that `geoms` can cover of an image."""
        corners = self._centres[geoms, None] + _CORNERS * self._halves[geoms, None]
        away = corners.reshape(-1, 3) - self._places[camera]
        right, up, back = (away @ self._turns[camera]).T
        if not len(back) or back.max() > -_MARGIN_M:
            return 0, 0, WIDTH_PX, HEIGHT_PX
        px = -_WIDER * HEIGHT_PX / 2 / self._lenses[camera][1] / back
        left, width = _span(right * px, WIDTH_PX)
        bottom, height = _span(up * px, HEIGHT_PX)
        return left, bottom, width, height

    def _above_slab(self, camera: int) -> Rows | None:
        """Bounds that each of `_FACES` must reach to be seen by `camera`; None: no slab hides it.

        It is the box around the camera and what it sees of a slab that fills its image.
        """
        x, y, z = self._places[camera].tolist()
        rays = (self._turns[camera] @ _corners(*self._lenses[camera])).T.tolist()
        if max(ray[2] for ray in rays) > -_LEAST_SLOPE:
            return None
        for slab in self._slabs:
            (centre_x, centre_y, centre_z), (half_x, half_y, half_z) = (
                rows[slab].tolist() for rows in (self._centres, self._halves)
            )
            height = z - (centre_z + half_z)
            xs = [x - ray[0] / ray[2] * height for ray in rays]
            ys = [y - ray[1] / ray[2] * height for ray in rays]
            if (
                height > _LEAST_HEIGHT_M
                and max(abs(at - centre_x) for at in xs) < half_x - _MARGIN_M
                and max(abs(at - centre_y) for at in ys) < half_y - _MARGIN_M
            ):
                lower = (min(x, *xs) - _MARGIN_M, min(y, *ys) - _MARGIN_M, z - height - _BELOW_M)
                return np.array([*lower, -max(x, *xs) - _MARGIN_M, -max(y, *ys) - _MARGIN_M, -z])
        return None


def _lens(fovy_rad: float) -> tuple[float, float]:
    """Tangents of half the horizontal and vertical field of view, a little widened."""
    up = _WIDER * math.tan(fovy_rad / 2)
    return up * WIDTH_PX / HEIGHT_PX, up


def _corners(right: float, up: float) -> Rows:
    """Rays through the image's corners in the camera's frame (right, up, backward), as columns."""
    return np.array([(right, right, -right, -right), (up, -up, up, -up), (-1, -1, -1, -1)])


def _span(places_px: Rows, size: int) -> tuple[int, int]:
    """First pixel and number of pixels, of `size`, that `places_px` from the centre span."""
    first = max(0, math.floor(places_px.min() + size / 2) - _MARGIN_PX)
    last = min(size, math.ceil(places_px.max() + size / 2) + _MARGIN_PX)
    return first, max(0, last - first)
