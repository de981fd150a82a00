"""Patches of one colour: where, how large, and how well their edges show it.

The strength of a colour is a difference of channels, so that a blurred edge keeps its place at
half strength. The edge's width and the noise about it are what the uncertainty is made of.
The block's yaw comes from the support function of its patch's outline in the wrist camera (how far
it reaches in each direction), compared with that of the block drawn at every yaw: where it is and
how much blur has grown it does not matter.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.layout import FINGER_TRAVEL_M
from hw.sim.operator.vision.solids import BLUE, GREEN, ORANGE, finger_boxes, sketch
from hw.sim.operator.vision.views import Matrix, Pinhole
from tams_app.records import Image, Vector

_WEAKEST = 40.0  # grey levels of colour that stand out at all
_FROM = 0.25  # of the top strength: inside
_FULL = 0.40  # of the top strength: as much as the dimmest side of a thing has
_TOP_PART = 0.25  # of the expected area shows the full strength, even when blurred
_SMALLEST_PART = 0.12  # of the largest patch: smaller ones are specks
_SOFT_EDGE_PX = 3
EDGE_JUDGEMENT = 0.10  # of an edge's width: how well its middle is judged
_STEADY_PX = 0.10  # from glance to glance, of what stands still on lossless images
_SAMPLING_PX = 0.20  # what is left of a perfect edge on a pixel grid


@dataclass(frozen=True, slots=True)
class Window:
    """A rectangle of an image; `left` and `top` are its corner's pixel."""

    left: int
    top: int
    patch: Image

    @staticmethod
    def about(image: Image, middle: Vector, radius_px: float) -> Window | None:
        """The part within `radius_px` of `middle`; None when hardly any of it is in the image."""
        height, width = image.shape[:2]
        left, top = (max(0, int(part - radius_px)) for part in middle)
        right, bottom = int(middle[0] + radius_px) + 1, int(middle[1] + radius_px) + 1
        if min(right, width) - left < 8 or min(bottom, height) - top < 8:
            return None
        return Window(left, top, image[top:bottom, left:right])

    @property
    def corner(self) -> Vector:
        return np.array((self.left, self.top), float)

    def holds(self, blob: Blob) -> bool:
        """True if the whole of `blob` is in it, not cut off at its border."""
        low = blob.outline.min(axis=0) - self.corner
        high = blob.outline.max(axis=0) - self.corner
        return bool(low.min() >= 1 and (high < np.array(self.patch.shape[1::-1]) - 2).all())


@dataclass(frozen=True, slots=True)
class Blob:
    """A coloured patch: middle [px], area [px²], edge width [px], noise over full strength."""

    middle: Vector
    area: float
    edge_px: float
    noise: float
    outline: Matrix  # its convex hull [px], shape (n, 2)

    @property
    def edge_sigma_px(self) -> float:
        """The uncertainty of one place on its edge [px]."""
        return math.hypot(_SAMPLING_PX, self.edge_px * math.hypot(EDGE_JUDGEMENT, self.noise))

    @property
    def sigma_px(self) -> float:
        """The uncertainty of its middle [px] from one glance to the next: noise along the edge."""
        places = max(1.0, math.sqrt(max(self.area, 1.0)) * 4.0 / self.edge_px)
        return math.hypot(_STEADY_PX, self.edge_px * self.noise * math.sqrt(2.0 / places))

    @property
    def lasting_px(self) -> float:
        """The error of its middle for as long as it looks like this [px]: sampling and blur."""
        return math.hypot(_SAMPLING_PX, self.edge_px * EDGE_JUDGEMENT)


def strength(patch: Image, colour: int) -> Image:
    """The amount of `colour` in each pixel of a BGR patch, in grey levels, uint8."""
    blue, green, red = cv2.split(np.ascontiguousarray(patch))  # a seventh of split's time alone
    if colour == ORANGE:
        return np.asarray(cv2.subtract(red, cv2.max(green, blue)), np.uint8)
    if colour == GREEN:
        return np.asarray(cv2.subtract(green, cv2.max(red, blue)), np.uint8)
    if colour == BLUE:
        return np.asarray(cv2.subtract(blue, red), np.uint8)
    raise ValueError(f"colour {colour} has no strength; use ORANGE, GREEN or BLUE")


def find_blobs(window: Window, colour: int, expected_area: float) -> list[Blob]:
    """The patches of `colour`, largest first; none when nothing stands out.

    `expected_area` [px²] of one of them, as far as is known: by it so many pixels show the full
    strength.
    """
    strong = strength(window.patch, colour)
    top = _top_strength(strong, expected_area)
    if top < _WEAKEST:
        return []
    inside = np.asarray(cv2.threshold(strong, _FROM * top, 255, cv2.THRESH_BINARY)[1], np.uint8)
    noise = _noise(strong, inside) / top
    # The same labels as by default, in less than half the time.
    count, *parts = cv2.connectedComponentsWithStatsWithAlgorithm(
        inside, 8, cv2.CV_32S, cv2.CCL_GRANA
    )
    labels, statistics = np.asarray(parts[0], np.int32), np.asarray(parts[1], np.int32)
    areas = statistics[1:count, cv2.CC_STAT_AREA]
    if not areas.size or 3.0 * noise > 1.0 - _FROM:
        return []
    order = np.argsort(areas, kind="stable")[::-1]
    wanted = [place + 1 for place in order if areas[place] >= _SMALLEST_PART * areas.max()]
    blobs = []
    for label in wanted[:3]:
        rows, columns = _frame(statistics[label])
        corner = window.corner + np.array((columns.start, rows.start))
        core = (labels[rows, columns] == label).view(np.uint8) * np.uint8(255)
        blobs.append(_measure(corner, strong[rows, columns], core, top, noise))
    return blobs


def _frame(statistics: NDArray[np.int32]) -> tuple[slice, slice]:
    """Rows and columns that hold a patch, its soft edge, and what its slopes are made of."""
    left, upper, width, height = (int(number) for number in statistics[:4])
    margin = _SOFT_EDGE_PX + 1
    rows = slice(max(0, upper - margin), upper + height + margin)
    return rows, slice(max(0, left - margin), left + width + margin)


def _top_strength(strong: Image, expected_area: float) -> float:
    """Strength that a quarter of the expected area reaches."""
    wanted = min(strong.size - 1, max(4, round(_TOP_PART * expected_area)))
    reached = np.cumsum(level_counts(strong)[::-1])
    return float(255 - int(np.searchsorted(reached, wanted)))


def level_counts(image: Image) -> NDArray[np.int64]:
    """The number of pixels of an 8-bit image with each grey level, shape (256,)."""
    counts = cv2.calcHist([image], [0], None, [256], [0, 256])
    return np.asarray(counts).ravel().astype(np.int64)


def _noise(strong: Image, inside: Image) -> float:
    """Root mean square of the strength well outside, in grey levels; all of it without outside."""
    outside = cv2.bitwise_not(cv2.dilate(inside, _disc(_SOFT_EDGE_PX + 1)))
    if not cv2.countNonZero(outside):
        return 255.0
    mean, deviation = cv2.meanStdDev(strong, mask=outside)
    return float(math.hypot(mean[0, 0], deviation[0, 0]))


def _slopes(strong: Image, edge: NDArray[np.bool_]) -> NDArray[np.int32]:
    """Steepness squared at an edge, in (grey levels per 8 pixels)²: whole numbers, always the same.

    In the order of its pixels.
    """
    across = cv2.Sobel(strong, cv2.CV_16S, 1, 0)[edge].astype(np.int32)
    down = cv2.Sobel(strong, cv2.CV_16S, 0, 1)[edge].astype(np.int32)
    return np.asarray(across * across + down * down, np.int32)


def _measure(corner: Vector, strong: Image, core: Image, top: float, noise: float) -> Blob:
    soft = cv2.dilate(core, _disc(_SOFT_EDGE_PX))
    # No more than half strength counts, so that a dim side weighs as much as a bright one.
    full = _FULL * top
    weight = cv2.bitwise_and(np.minimum(strong, np.uint8(round(full))), soft)
    moments = cv2.moments(weight)
    middle = corner + np.array((moments["m10"], moments["m01"])) / moments["m00"]
    edge = cv2.bitwise_xor(soft, cv2.erode(core, _disc(1)))
    steep = _slopes(strong, edge > 0)
    # One of them, not their mean: partition leaves an order that is not the same every time.
    count = max(1, steep.size // 14)
    steepest = math.sqrt(float(np.partition(steep, -count)[-count])) / 8 if steep.size else 0.0
    contours, _ = cv2.findContours(core, cv2.RETR_EXTERNAL, cv2.CHAIN_APPROX_NONE)
    hull = cv2.convexHull(max(contours, key=len)).reshape(-1, 2)
    return Blob(
        middle, moments["m00"] / full, top / max(steepest, 1.0), noise, corner + hull.astype(float)
    )


def _disc(radius: int) -> Image:
    return np.ones((2 * radius + 1, 2 * radius + 1), np.uint8)


OPEN_M = 2.0 * FINGER_TRAVEL_M
_RADIUS_M = 0.032
_ALIKE = 0.5  # of two pads, the smaller has at least this part of the larger one's area
_CLOSED_PART = 1.4  # of one pad's area: both as one patch


class FingerGauge:
    """Reads the opening off the distance of the pads' middles; the camera rides on the tool."""

    def __init__(self, camera: Pinhole) -> None:
        """`camera` in the tool's frame."""
        pads = np.array([(0.0, 0.0, -0.007)])
        self._middle = camera.project(pads)[0]
        self._radius = camera.focal_px * _RADIUS_M / float(camera.depths(pads)[0])
        self._expected = [self._expect(camera, opening) for opening in (0.25 * OPEN_M, OPEN_M)]

    def measure(self, image: Image) -> float | None:
        """The opening [m]; None when the pads cannot be made out."""
        window = Window.about(image, self._middle, self._radius)
        area = self._expected[1][1]
        blobs = find_blobs(window, GREEN, area) if window is not None else []
        if not blobs or blobs[0].area < 0.4 * area:
            return None
        if len(blobs) == 1 or blobs[1].area < _ALIKE * blobs[0].area:
            return 0.0 if blobs[0].area > _CLOSED_PART * area else None
        apart = abs(float(blobs[0].middle[0] - blobs[1].middle[0]))
        (near_px, _), (wide_px, _) = self._expected
        opening = OPEN_M * (0.25 + 0.75 * (apart - near_px) / (wide_px - near_px))
        return float(np.clip(opening, 0.0, OPEN_M))

    def _expect(self, camera: Pinhole, opening: float) -> tuple[float, float]:
        """Distance of the pads' middles [px] and the area of one [px²] at `opening` [m]."""
        boxes = finger_boxes(opening)
        half = len(boxes) // 2
        left, right = (
            sketch(camera, side, GREEN, self._middle, self._radius)
            for side in (boxes[:half], boxes[half:])
        )
        return float(right.middle[0] - left.middle[0]), right.area


_DIRECTIONS = 24
_STEP_RAD = math.radians(2.5)
QUARTER_TURN: Vector = np.arange(-18.0, 18.0) * _STEP_RAD  # all yaws of what has a square outline
HALF_TURN: Vector = np.arange(-36.0, 36.0) * _STEP_RAD  # and of what has an oblong one
_NOT_A_BLOCK_PX = 3.0
_LEAST_SIGMA_RAD = math.radians(0.3)
_PER_CORNER = _DIRECTIONS / 6  # a box's outline has six corners: so many directions err alike
_FITTED = 4  # yaw, place and growth
_ANGLES = np.arange(_DIRECTIONS) * (2.0 * math.pi / _DIRECTIONS)
_NORMALS = np.stack((np.cos(_ANGLES), np.sin(_ANGLES)))
_BASIS = np.linalg.qr(np.column_stack((*_NORMALS, np.ones(_DIRECTIONS))))[0]


@dataclass(frozen=True, slots=True)
class YawFit:
    """Yaw and its standard deviation [rad], and what the best drawing leaves over [px].

    `lasting`: the part of the standard deviation that the next glances at the same image repeat.
    """

    yaw: float
    sigma: float
    lasting: float
    misfit_px: float


def fit_yaw(
    outline: Matrix,
    edge_sigma_px: float,
    draw: Callable[[Vector], Matrix],
    yaws: Vector = QUARTER_TURN,
) -> YawFit | None:
    """The yaw at which the drawing fits best; None when it is no such thing at all.

    `yaws`: those to try [rad], evenly spaced, the first following the last.
    `outline`: the hull seen [px], shape (n, 2); `draw`: corners [px] of the block at each of
    several yaws, shape (yaws, corners, 2).
    """
    seen = (outline @ _NORMALS).max(axis=0)
    drawn = (draw(yaws) @ _NORMALS).max(axis=1)
    gaps = seen - drawn
    gaps = gaps - (gaps @ _BASIS) @ _BASIS.T
    costs = (gaps**2).sum(axis=1)
    best = int(np.argmin(costs))
    misfit_px = math.sqrt(costs[best] / _DIRECTIONS)
    if misfit_px > _NOT_A_BLOCK_PX:
        return None
    # The cost repeats itself, so the neighbours of the first are the second and the last.
    before, after = costs[best - 1], costs[(best + 1) % len(costs)]
    bend = before + after - 2.0 * costs[best]
    if bend <= 0.0:
        return None
    yaw = float(yaws[best] + 0.5 * (before - after) / bend * _STEP_RAD)
    left = max(edge_sigma_px**2, float(costs[best]) / (_DIRECTIONS - _PER_CORNER * _FITTED))
    variance = _PER_CORNER * 2.0 * left / bend * _STEP_RAD**2
    # Half of it is there again in the next glance: measured, sharp, blurred and blocked alike.
    half = math.sqrt(variance / 2.0)
    return YawFit(yaw, math.hypot(half, _LEAST_SIGMA_RAD), half, misfit_px)
