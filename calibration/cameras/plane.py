"""What a camera with a real lens sees of a flat thing: a board or a screen held before it."""

from __future__ import annotations

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from tams_app.records import Image, Vector

Matrix = NDArray[np.float64]
_SUPERSAMPLED = 2  # each way
GAMMA = 2.2
_LIGHT = ((np.arange(256) / 255) ** GAMMA).astype(np.float32)  # by grey level


class Lens:
    """A pinhole with OpenCV's distortion k1, k2, p1, p2, k3; `matrix` is K [px], shape (3, 3)."""

    def __init__(self, matrix: Matrix, distortion: Matrix, width: int, height: int) -> None:
        self.matrix, self.distortion = matrix, distortion
        self.size = (width, height)
        # sub-pixels, so that edges come out as a sensor's pixels average them
        step = 1 / _SUPERSAMPLED
        x, y = np.meshgrid(
            np.arange(width * _SUPERSAMPLED) * step - 0.5 + step / 2,
            np.arange(height * _SUPERSAMPLED) * step - 0.5 + step / 2,
        )
        pixels = np.stack([x.ravel(), y.ravel()], axis=1)[:, None]
        criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 40, 1e-9)
        rays = cv2.undistortPointsIter(pixels, matrix, distortion, np.eye(3), np.eye(3), criteria)[
            :, 0
        ]
        self._rays = np.column_stack([rays, np.ones(len(rays))])

    def window_on(self, pose: Placed, pixels_per_m: float, shape: tuple[int, int]) -> Window:
        """To see flat images of `shape` (height, width) there, again and again."""
        normal = pose.axes[:, 2]
        with np.errstate(divide="ignore", invalid="ignore"):
            distance = (normal @ pose.origin) / (self._rays @ normal)
        points = self._rays * distance[:, None] - pose.origin
        u = (points @ pose.axes[:, 0] * pixels_per_m - 0.5).astype(np.float32)
        v = (points @ pose.axes[:, 1] * pixels_per_m - 0.5).astype(np.float32)
        u[~(distance > 0)] = -1e4
        width, height = self.size
        fine = (height * _SUPERSAMPLED, width * _SUPERSAMPLED)
        return Window(u.reshape(fine), v.reshape(fine), shape, self.size)


class Window:
    """Where each pixel of a camera looks on a flat image, which may change."""

    def __init__(
        self,
        u: NDArray[np.float32],
        v: NDArray[np.float32],
        shape: tuple[int, int],
        size: tuple[int, int],
    ) -> None:
        self._u, self._v, self._size = u, v, size
        height, width = shape
        inside = (u > -0.5) & (u < width - 0.5) & (v > -0.5) & (v < height - 0.5)
        cover = cv2.resize(inside.astype(np.float32), size, interpolation=cv2.INTER_AREA)
        self._uncovered = np.asarray(1 - cover[..., None], np.float32)

    def see(self, flat: Image, behind: Image) -> Image:
        """The image `behind` with `flat` before it; both BGR."""
        sampled = cv2.remap(
            flat,
            self._u,
            self._v,
            cv2.INTER_LINEAR,
            borderMode=cv2.BORDER_CONSTANT,
            borderValue=(0, 0, 0),
        )
        seen = cv2.resize(sampled, self._size, interpolation=cv2.INTER_AREA)
        return np.asarray(np.clip(np.rint(seen + behind * self._uncovered), 0, 255), np.uint8)


class Placed:
    """Where a flat thing is in the camera's frame (x right, y down, z forward) [m].

    `origin`: its top left corner; columns of `axes`: along its width, along its height, and away.
    """

    def __init__(self, centre: Vector, rotation: Rotation, width_m: float, height_m: float) -> None:
        self.axes = rotation.as_matrix()
        half = self.axes[:, 0] * width_m / 2 + self.axes[:, 1] * height_m / 2
        self.origin = np.asarray(centre, float) - half


def lens_of(focal_px: float, width: int, height: int) -> Lens:
    """One without distortion that looks along the middle of its image."""
    matrix = np.array(
        [[focal_px, 0, (width - 1) / 2], [0, focal_px, (height - 1) / 2], [0, 0, 1.0]]
    )
    return Lens(matrix, np.zeros(5), width, height)


def exposed(images: list[Image], shares: list[float]) -> Image:
    """One exposure over several scenes: their light adds up, greys do not; shares sum to 1."""
    if len(images) == 1:
        return images[0]
    light = np.zeros(images[0].shape, np.float32)
    for image, share in zip(images, shares, strict=True):
        light += np.float32(share) * _LIGHT[image]
    return np.asarray(np.rint(255 * np.clip(light, 0, 1) ** (1 / GAMMA)), np.uint8)
