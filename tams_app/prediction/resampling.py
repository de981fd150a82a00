"""Pictures taken apart and put together anew, where the rays of their pixels have changed."""

from __future__ import annotations

from collections.abc import Callable
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from tams_app.records import Image, Lens

_CELL_PX = 8  # of the mesh on which the map is computed; between its points it is linear
_FAR_PX = 1e4
_LEAST_DEPTH = 1e-6
_ONE_MAP = np.empty(0, np.float32)  # the second map, where the first has both coordinates

Resample: TypeAlias = Callable[[Image, int], Image]
"""The picture now, of a picture then and one of OpenCV's ways to interpolate."""


class RayMap:
    """Undistorts each pixel's ray once; each picture costs a coarse mesh and one remapping.

    Linear between points 8 pixels apart, the map is off by less than 0.05 px
    (`tests/prediction/test_bent_lens.py`). A lens without distortion has the same map: a
    homography of the whole picture takes OpenCV twice as long.
    """

    def __init__(self, lens: Lens) -> None:
        self._lens = lens
        across, down = (_mesh(size) for size in (lens.width, lens.height))
        x, y = np.meshgrid(across, down)
        slopes = lens.slopes(np.stack((x, y), axis=-1).reshape(-1, 2))
        self._rays = np.insert(slopes, 2, 1.0, axis=1)
        self._shape = len(down), len(across)

    def __call__(self, change: NDArray[np.float64]) -> Resample:
        """What makes a picture now of one then; `change`: from rays now to those then, (3, 3)."""
        places = self.places(change)

        def resample(image: Image, how: int) -> Image:
            return np.asarray(cv2.remap(image, places, _ONE_MAP, how), np.uint8)

        return resample

    def places(self, change: NDArray[np.float64]) -> NDArray[np.float32]:
        """Where each pixel now was then [px], shape (height, width, 2)."""
        then = self._rays @ change.T
        depth = np.maximum(then[:, 2:], _LEAST_DEPTH)
        pixels = np.clip(self._lens.pixels(then[:, :2] / depth), -_FAR_PX, _FAR_PX)
        mesh = pixels.astype(np.float32).reshape(*self._shape, 2)
        rows, columns = self._shape
        fine = cv2.resize(mesh, (columns * _CELL_PX, rows * _CELL_PX))
        window = np.s_[
            _CELL_PX : _CELL_PX + self._lens.height, _CELL_PX : _CELL_PX + self._lens.width
        ]
        return np.asarray(fine[window], np.float32)


def _mesh(size: int) -> NDArray[np.float64]:
    """The middles of cells along a picture's side, with one more at each end."""
    cells = -(-size // _CELL_PX) + 2
    return np.asarray((np.arange(cells) - 0.5) * _CELL_PX - 0.5)
