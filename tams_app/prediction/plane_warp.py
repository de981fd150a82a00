"""A picture of a plane, as a camera sees it that has moved since: a homography.

With cameras at p₀ and p₁, rotations R₀ and R₁ (axes right, down, forwards as columns, base frame),
camera matrix K and the plane z = h, a point that is at x₁ in the picture now was at

    x₀ ~ K (R₀ᵀ R₁ + R₀ᵀ (p₁ - p₀) (R₁ᵀ e_z)ᵀ / (h - p₁_z)) K⁻¹ x₁

(Hartley and Zisserman, Multiple View Geometry, 13.1, of a plane that is given in the base frame.)
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from tams_app.records import Image, Lens, Pose, Solid, SolidKind

_LEAST_HEIGHT_M = 0.02  # of the camera above the plane
_NEAR_M = 0.005  # before the camera: what is nearer is not drawn into a mask
_MARGIN_PX = 3
_FACETS = 16
_UNSEEN = 64  # grey level of places that the frame did not show


def mounted(pose: Pose, mount: Pose) -> Pose:
    """The pose in the base frame of what is mounted at `mount` on something at `pose`."""
    return Pose(pose.position + pose.rotation.apply(mount.position), pose.rotation * mount.rotation)


def plane_homography(
    lens: Lens, then: Pose, now: Pose, height_m: float
) -> NDArray[np.float64] | None:
    """From pixels now to those then, shape (3, 3), of the plane z = `height_m` in the base frame.

    `then`, `now`: the camera's poses in the base frame. None where a camera is not 20 mm above the
    plane, or sees more than the plane: its horizon.
    """
    if min(then.position[2], now.position[2]) < height_m + _LEAST_HEIGHT_M:
        return None
    matrix = lens.matrix()
    inverse = np.linalg.inv(matrix)
    axes_then, axes_now = then.rotation.as_matrix(), now.rotation.as_matrix()
    corners = product((0.0, lens.width - 1.0), (0.0, lens.height - 1.0))
    rays = np.array([(x, y, 1.0) for x, y in corners]) @ inverse.T
    if ((rays @ axes_now.T)[:, 2] >= 0.0).any() or ((rays @ axes_then.T)[:, 2] >= 0.0).any():
        return None
    moved = axes_then.T @ (now.position - then.position)
    normal = axes_now[2]
    turned = axes_then.T @ axes_now
    change = turned + np.outer(moved, normal) / (height_m - now.position[2])
    homography = matrix @ change @ inverse
    return np.asarray(homography / homography[2, 2])


def covered_by(solids: Iterable[Solid], lens: Lens) -> NDArray[np.bool_]:
    """The pixels, shape (height, width), before which `solids` of the camera's parent frame are.

    And a margin of 3 pixels about them.
    """
    size = 2 * _MARGIN_PX + 1
    return cv2.dilate(silhouette(solids, lens), np.ones((size, size), np.uint8)) > 0


def silhouette(solids: Iterable[Solid], lens: Lens) -> Image:
    """255 where `solids` of the camera's parent frame are in the picture, shape (height, width)."""
    covered = np.zeros((lens.height, lens.width), np.uint8)
    for solid in solids:
        pixels = projected(corners_of(solid), lens)
        if len(pixels) >= 3:
            cv2.fillConvexPoly(covered, cv2.convexHull(np.rint(pixels).astype(np.int32)), 255)
    return covered


def projected(points: NDArray[np.float64], lens: Lens) -> NDArray[np.float64]:
    """Where the camera sees those of `points`, shape (n, 3), that are before it [px], shape (m, 2).

    The points are in the camera's parent frame.
    """
    seen = (points - lens.pose.position) @ lens.pose.rotation.as_matrix()  # in the camera's axes
    seen = seen[seen[:, 2] > _NEAR_M]
    pixels = seen @ lens.matrix().T
    flat: NDArray[np.float64] = np.clip(pixels[:, :2] / pixels[:, 2:], -1e4, 1e4)
    return flat


def corners_of(solid: Solid) -> NDArray[np.float64]:
    """Points of its parent frame whose hull it is."""
    half = np.array(solid.extent) / 2.0
    if solid.kind is SolidKind.BOX:
        corners = np.array(list(product((-1.0, 1.0), repeat=3))) * half
    else:
        angles = np.linspace(0.0, 2.0 * np.pi, _FACETS, endpoint=False)
        circle = np.stack((np.cos(angles), np.sin(angles)), axis=1) / np.cos(np.pi / _FACETS)
        corners = np.array([(x, y, z) for x, y in circle for z in (-1.0, 1.0)]) * half
    points: NDArray[np.float64] = solid.pose.position + solid.pose.rotation.apply(corners)
    return points


@dataclass(frozen=True, slots=True)
class Warped:
    """A picture as it would look now; `unseen`: the share of it that the frame did not show."""

    image: Image
    unseen: float


class WristWarp:
    """Warps the frames of a camera on the arm; for one size of picture."""

    def __init__(
        self,
        lens: Lens,
        tool: Iterable[Solid],
        grip: Iterable[Solid] = (),
        height_m: float = 0.0,
    ) -> None:
        """`tool`: what moves with the camera and stands still in its picture, in the mount's frame.

        `grip`: what does so besides while the gripper is closed. `height_m`: of the plane that the
        scene is taken for, base frame.
        """
        self._lens, self._height_m = lens, height_m
        still = covered_by(tool, lens)
        self._still = {False: still, True: still | covered_by(grip, lens)}
        self._seen = {
            closed: np.where(still, 0, 255).astype(np.uint8)
            for closed, still in self._still.items()
        }

    def to_now(self, image: Image, then: Pose, now: Pose, closed: bool = False) -> Warped | None:
        """`image`, taken with the lens's parent at `then`, as seen from `now`; None: it cannot be.

        Grey or BGR. Tool and gripper stay as received, and if that is `closed` what it holds. Dark
        grey is what the frame did not show.
        """
        lens, still = self._lens, self._still[closed]
        place = mounted(then, lens.pose), mounted(now, lens.pose)
        homography = plane_homography(lens, *place, self._height_m)
        if homography is None:
            return None
        size = lens.width, lens.height
        inverse = cv2.WARP_INVERSE_MAP
        warped = cv2.warpPerspective(image, homography, size, flags=cv2.INTER_LINEAR | inverse)
        seen = cv2.warpPerspective(
            self._seen[closed], homography, size, flags=cv2.INTER_NEAREST | inverse
        ).astype(bool)
        unseen = ~(seen | still)
        warped[unseen] = _UNSEEN
        warped[still] = image[still]
        return Warped(np.asarray(warped, np.uint8), float(unseen.mean()))
