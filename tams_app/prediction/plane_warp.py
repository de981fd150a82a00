"""A picture of a plane, as a camera sees it that has moved since: a homography.

With cameras at p₀ and p₁, rotations R₀ and R₁ (axes right, down, forwards as columns, base frame),
camera matrix K and the plane z = 0, a point that is at x₁ in the picture now was at

    x₀ ~ K (R₀ᵀ R₁ - R₀ᵀ (p₁ - p₀) (R₁ᵀ e_z)ᵀ / p₁_z) K⁻¹ x₁

(Hartley and Zisserman, Multiple View Geometry, 13.1, of a plane that is given in the base frame.)
A lens that distorts stands in K's place: x₁ is undistorted to its ray, and the ray then distorted.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from itertools import product

import cv2
import numpy as np
from numpy.typing import NDArray

from tams_app.records import FAR_PX, Image, Lens, Pose, Solid, SolidKind

_LEAST_HEIGHT_M = 0.02  # of the camera above the plane
_MARGIN_PX = 3
_FACETS = 16
_UNSEEN = 64  # grey level of places that the frame did not show
_BORDER_POINTS = 9  # of each side of a picture that is distorted
_EDGE_PX, _MOST_BETWEEN = 16.0, 64  # how far apart are points of an edge that is bent
_CELL_PX = 8  # of the mesh on which the map is computed; between its points it is linear
_LEAST_DEPTH = 1e-6
_ONE_MAP = np.empty(0, np.float32)  # the second map, where the first has both coordinates


def mounted(pose: Pose, mount: Pose) -> Pose:
    """The pose in the base frame of what is mounted at `mount` on something at `pose`."""
    return Pose(pose.position + pose.rotation.apply(mount.position), pose.rotation * mount.rotation)


def inverse(pose: Pose) -> Pose:
    """The parent frame in the frame itself."""
    back = pose.rotation.inv()
    return Pose(-back.apply(pose.position), back)


def plane_change(border: NDArray[np.float64], then: Pose, now: Pose) -> NDArray[np.float64] | None:
    """From rays now to those then, shape (3, 3), of the plane z = 0 in the base frame.

    `border`: rays in the camera's axes, shape (n, 3), between which its picture is. `then`, `now`:
    the camera's poses in the base frame. None where a camera is not 20 mm above the plane, or sees
    more than the plane: its horizon.
    """
    if min(then.position[2], now.position[2]) < _LEAST_HEIGHT_M:
        return None
    axes_then, axes_now = then.rotation.as_matrix(), now.rotation.as_matrix()
    if ((border @ axes_now.T)[:, 2] >= 0.0).any() or ((border @ axes_then.T)[:, 2] >= 0.0).any():
        return None
    moved = axes_then.T @ (now.position - then.position)
    normal = axes_now[2]
    turned = axes_then.T @ axes_now
    return np.asarray(turned + np.outer(moved, normal) / -now.position[2])


def border_rays(lens: Lens) -> NDArray[np.float64]:
    """The rays of the corners of a picture, shape (n, 3), and of places between if it is bent."""
    steps = _BORDER_POINTS if lens.is_distorted else 2
    across, down = (np.linspace(0.0, size - 1.0, steps) for size in (lens.width, lens.height))
    sides = [(x, y) for x in across for y in (0.0, lens.height - 1.0)]
    sides += [(x, y) for x in (0.0, lens.width - 1.0) for y in down]
    return np.insert(lens.slopes(np.array(sides)), 2, 1.0, axis=1)


def covered_by(solids: Iterable[Solid], lens: Lens) -> NDArray[np.bool_]:
    """The pixels, shape (height, width), before which `solids` of the camera's parent frame are.

    And a margin of 3 pixels about them.
    """
    size = 2 * _MARGIN_PX + 1
    shape = silhouette([corners_of(solid) for solid in solids], lens)
    return cv2.dilate(shape, np.ones((size, size), np.uint8)) > 0


def silhouette(hulls: Sequence[NDArray[np.float64]], lens: Lens) -> Image:
    """255 where solids are in the picture, shape (height, width).

    `hulls`: points of the camera's parent frame, shape (n, 3), whose hull each of the solids is.
    """
    covered = np.zeros((lens.height, lens.width), np.uint8)
    if not hulls:
        return covered
    is_seen, slopes = lens.slopes_to(np.concatenate(hulls))
    numbers = np.repeat(np.arange(len(hulls)), [len(hull) for hull in hulls])[is_seen]
    each = np.searchsorted(numbers, np.arange(1, len(hulls)))
    if lens.is_distorted:  # the hull is of straight lines, which the picture bends
        for corners in np.split(slopes, each):
            if len(corners) > 2:
                hull = cv2.convexHull(corners.astype(np.float32))[:, 0].astype(float)
                bent = lens.pixels(_between(hull, _EDGE_PX / lens.fx))
                cv2.fillPoly(covered, [_whole(bent)], 255)
        return covered
    for pixels in np.split(_whole(lens.pixels(slopes)), each):
        if len(pixels) > 2:
            cv2.fillConvexPoly(covered, cv2.convexHull(pixels), 255)
    return covered


def _whole(pixels: NDArray[np.float64]) -> NDArray[np.int32]:
    return np.rint(np.clip(pixels, -FAR_PX, FAR_PX)).astype(np.int32)


def _between(corners: NDArray[np.float64], step: float) -> NDArray[np.float64]:
    """A polygon's corners, shape (n, 2), and points on its edges, about `step` apart."""
    ends = np.roll(corners, -1, axis=0)
    longest = float(np.abs(ends - corners).max())
    shares = np.linspace(0.0, 1.0, min(_MOST_BETWEEN, 1 + int(longest / step)), endpoint=False)
    return np.asarray(
        (corners[:, None] + shares[:, None] * (ends - corners)[:, None]).reshape(-1, 2)
    )


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

    def places(self, change: NDArray[np.float64]) -> NDArray[np.float32]:
        """Where each pixel now was then [px], shape (height, width, 2).

        `change`: from rays now to those then, shape (3, 3).
        """
        then = self._rays @ change.T
        depth = np.maximum(then[:, 2:], _LEAST_DEPTH)
        pixels = np.clip(self._lens.pixels(then[:, :2] / depth), -FAR_PX, FAR_PX)
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


class WristWarp:
    """Warps the frames of a camera on the arm; for one size of picture."""

    def __init__(self, lens: Lens, tool: Iterable[Solid], grip: Iterable[Solid] = ()) -> None:
        """`tool`: what moves with the camera and stands still in its picture, in the mount's frame.

        `grip`: what does so besides while the gripper is closed.
        """
        self._lens, self._border, self._map = lens, border_rays(lens), RayMap(lens)
        fixed, held = (covered_by(each, lens) * np.uint8(255) for each in (tool, grip))
        self._still = {False: fixed, True: fixed | held}

    def to_now(self, image: Image, then: Pose, now: Pose, closed: bool = False) -> Image | None:
        """`image`, taken with the lens's parent at `then`, as seen from `now`; None: it cannot be.

        Grey or BGR. Tool and gripper stay as received, and if that is `closed` what it holds. Dark
        grey is what the frame did not show.
        """
        lens, still = self._lens, self._still[closed]
        place = mounted(then, lens.pose), mounted(now, lens.pose)
        change = plane_change(self._border, *place)
        if change is None:
            return None
        places = self._map.places(change)
        warped = np.asarray(cv2.remap(image, places, _ONE_MAP, cv2.INTER_LINEAR), np.uint8)
        seen = np.asarray(cv2.remap(~still, places, _ONE_MAP, cv2.INTER_NEAREST), np.uint8)
        unseen = ~(seen | still)  # masks of 0 and 255, by which OpenCV copies at once
        cv2.copyTo(np.full_like(image, _UNSEEN), unseen, warped)
        cv2.copyTo(image, still, warped)
        return warped
