"""What it takes to draw an arm and the things around it: solids, where they are, and cameras."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from enum import Enum
from functools import cache
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from tams_app.records.record import Pose, Vector
from tams_app.vectors import Floats3


class SolidKind(Enum):
    """The forms there are."""

    BOX = "box"
    CYLINDER = "cylinder"  # along z


@dataclass(frozen=True, slots=True)
class Solid:
    """A form in some frame: its middle, its whole extent x, y, z [m], its colour (0 to 1)."""

    kind: SolidKind
    pose: Pose
    extent: Floats3
    colour: Floats3


class ArmFigure(Protocol):
    """How an arm looks."""

    @property
    def flange(self) -> str:
        """The frame that the tool is mounted on."""

    @property
    def solids(self) -> Mapping[str, tuple[Solid, ...]]:
        """Those of each link, by the name of its frame; `base` does not move. Fingers are open."""

    @property
    def grip(self) -> tuple[Solid, ...]:
        """What closed fingers cover besides, with what they may hold, in the flange's frame."""

    def place(self, joints: Vector) -> Mapping[str, Pose]:
        """Where the links' frames are in the base frame, for `joints` [rad], shape (6,)."""


def focal_length_px(fovy_deg: float, height_px: int) -> float:
    """The focal length of a lens with this vertical field of view."""
    return height_px / 2.0 / math.tan(math.radians(fovy_deg) / 2.0)


FAR_PX = 1e4  # from the middle: pixels beyond are as far off as this
_NEAR_M = 0.005  # before the camera: what is nearer is not seen
NO_DISTORTION = (0.0, 0.0, 0.0, 0.0, 0.0)
_BEYOND = 1.2  # times the farthest corner: from there on the distortion grows no more
_STEPS = 256
_SAME_SHAPE = 0.005  # of the ratio of width to height
_ITERATIONS, _EXACT = 20, 1e-10


@dataclass(frozen=True, slots=True)
class Lens:
    """The pose of a view's camera in the frame `parent`, and how it makes its picture.

    `pose`: x to the right, y down, z forwards in the picture. Focal lengths and principal point are
    in pixels, which have whole numbers in their middle, as OpenCV has them. `distortion`: k1, k2,
    p1, p2, k3 of Brown's model, OpenCV's and `plumb_bob` of ROS.
    """

    parent: str
    pose: Pose
    fx: float
    fy: float
    cx: float
    cy: float
    width: int
    height: int
    distortion: tuple[float, float, float, float, float] = NO_DISTORTION

    @staticmethod
    def ideal(parent: str, pose: Pose, fovy_deg: float, width: int, height: int) -> Lens:
        """Square pixels, the axis through the middle, no distortion; a vertical field of view."""
        focal = focal_length_px(fovy_deg, height)
        middle_x, middle_y = (width - 1) / 2.0, (height - 1) / 2.0
        return Lens(parent, pose, focal, focal, middle_x, middle_y, width, height)

    @property
    def is_distorted(self) -> bool:
        """Whether a straight line may be bent in the picture."""
        return any(self.distortion)

    @property
    def is_invertible(self) -> bool:
        """Whether each pixel belongs to one ray: the distortion turns back nowhere in it."""
        return math.isfinite(self._reach)

    def turns_back_at(self, pixels: NDArray[np.float64], margin: float = 0.0) -> bool:
        """Whether the distortion turns back before the outermost of `pixels`, or soon after it.

        `margin`: how far beyond, as a share of its distance from the axis. Shape (n, 2).
        """
        seen = (pixels - (self.cx, self.cy)) / (self.fx, self.fy)
        outermost = float(np.linalg.norm(seen, axis=1).max())
        return math.isinf(_reach_of(self.distortion, (1.0 + margin) * outermost))

    def matrix(self) -> NDArray[np.float64]:
        """Camera matrix, shape (3, 3), whose pixels have whole numbers in their middle."""
        return np.array([(self.fx, 0.0, self.cx), (0.0, self.fy, self.cy), (0.0, 0.0, 1.0)])

    def scaled_to(self, width: int, height: int) -> Lens | None:
        """The same lens for pictures of another size; None for those of another shape."""
        if abs(self.width * height / (self.height * width) - 1.0) > _SAME_SHAPE:
            return None
        along, down = width / self.width, height / self.height
        return replace(
            self,
            fx=self.fx * along,
            fy=self.fy * down,
            cx=(self.cx + 0.5) * along - 0.5,
            cy=(self.cy + 0.5) * down - 0.5,
            width=width,
            height=height,
        )

    def pixels(self, slopes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where the rays (x, y, 1) of the camera's axes come to be [px], shapes (n, 2)."""
        focal, middle = np.array((self.fx, self.fy)), np.array((self.cx, self.cy))
        bent = self._bent(slopes) if self.is_distorted else slopes
        return np.asarray(bent * focal + middle)

    def slopes(self, pixels: NDArray[np.float64]) -> NDArray[np.float64]:
        """The rays (x, y, 1), in the camera's axes, of these pixels; shapes (n, 2)."""
        focal, middle = np.array((self.fx, self.fy)), np.array((self.cx, self.cy))
        seen = (pixels - middle) / focal
        if not self.is_distorted:
            return np.asarray(seen)
        slopes: NDArray[np.float64] = seen.copy()
        for _ in range(_ITERATIONS):
            error = self._bent(slopes) - seen
            if np.abs(error).max(initial=0.0) < _EXACT:
                break
            slopes -= self._correction(slopes, error)
        return slopes

    def slopes_to(
        self, points: NDArray[np.float64]
    ) -> tuple[NDArray[np.bool_], NDArray[np.float64]]:
        """Which `points` are before the camera, and the rays (x, y, 1) to those, shape (m, 2).

        `points`: in the parent frame, shape (n, 3).
        """
        seen = (points - self.pose.position) @ self.pose.rotation.as_matrix()  # in camera axes
        is_seen = seen[:, 2] > _NEAR_M
        seen = seen[is_seen]
        return is_seen, np.asarray(seen[:, :2] / seen[:, 2:])

    def projected(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Where the camera sees those of `points` that are before it [px], shape (m, 2).

        `points`: in the parent frame, shape (n, 3).
        """
        return np.clip(self.pixels(self.slopes_to(points)[1]), -FAR_PX, FAR_PX)

    @property
    def _reach(self) -> float:
        """How far off the axis (tangent) the distortion is followed; infinite: it turns back."""
        x = max(self.cx + 0.5, self.width - 0.5 - self.cx) / self.fx
        y = max(self.cy + 0.5, self.height - 0.5 - self.cy) / self.fy
        return _reach_of(self.distortion, math.hypot(x, y))

    def _bent(self, slopes: NDArray[np.float64]) -> NDArray[np.float64]:
        """Distorted. Beyond the picture the factor stays: a polynomial would turn back there."""
        k1, k2, p1, p2, k3 = self.distortion
        x, y = slopes[..., 0], slopes[..., 1]
        squared = x * x + y * y
        near = np.minimum(squared, self._reach**2)
        radial = 1.0 + near * (k1 + near * (k2 + near * k3))
        if not (p1 or p2):
            return slopes * radial[..., None]
        inner = np.sqrt(near / np.maximum(squared, 1e-30))
        x_in, y_in = x * inner, y * inner
        across = np.stack(
            (
                2.0 * p1 * x_in * y_in + p2 * (near + 2.0 * x_in * x_in),
                p1 * (near + 2.0 * y_in * y_in) + 2.0 * p2 * x_in * y_in,
            ),
            axis=-1,
        )
        return np.asarray(slopes * radial[..., None] + across)

    def _correction(
        self, slopes: NDArray[np.float64], error: NDArray[np.float64]
    ) -> NDArray[np.float64]:
        """Newton's step, with differences for the Jacobian."""
        step = 1e-6
        here = self._bent(slopes)
        along_x = (self._bent(slopes + np.array((step, 0.0))) - here) / step
        along_y = (self._bent(slopes + np.array((0.0, step))) - here) / step
        det = along_x[..., 0] * along_y[..., 1] - along_y[..., 0] * along_x[..., 1]
        dx = (along_y[..., 1] * error[..., 0] - along_y[..., 0] * error[..., 1]) / det
        dy = (along_x[..., 0] * error[..., 1] - along_x[..., 1] * error[..., 0]) / det
        return np.stack((dx, dy), axis=-1)


@cache
def _reach_of(distortion: tuple[float, float, float, float, float], corner: float) -> float:
    """1.2 times the undistorted radius of what is seen at `corner`; infinite: nothing is there."""
    k1, k2, _, _, k3 = distortion
    radii = np.linspace(0.0, 3.0 * corner, _STEPS)
    squared = radii * radii
    seen = radii * (1.0 + squared * (k1 + squared * (k2 + squared * k3)))
    turns = np.nonzero(np.diff(seen) <= 0.0)[0]
    grows = radii[: turns[0] + 1 if len(turns) else _STEPS]
    if seen[len(grows) - 1] < corner:
        return math.inf
    reached = np.interp(corner, seen[: len(grows)], grows)
    return float(min(_BEYOND * reached, grows[-1]))
