"""ArUco markers: which, and where their corners are, with what the fit leaves over."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from hw.sim.layout import MARKER_HALF_M, TCP_OFFSET_M
from hw.sim.operator.vision.blobs import EDGE_JUDGEMENT, Window, level_counts
from hw.sim.operator.vision.views import Cue, Matrix, Sighting, Thing
from tams_app.records import Image, Vector

FACES = (Cue.MARKER_AHEAD, Cue.MARKER_LEFT, Cue.MARKER_RIGHT)
# Of a window's longer side, so at most 29 px, and a marker is 24 cells about: what is smaller
# cannot be read, but took more than half of the time.
_LEAST_PERIMETER = 0.045
_CORNER_PX = 0.15  # of a sharp corner at its best
_SHRINKS = 0.25  # of an edge's width: how far blur draws corners inwards, measured
_SHIFT_COSTS = 0.1  # a face that lies far off must fit that much better
_ORDERS = np.array(
    [np.roll(order, turn) for order in ((0, 1, 2, 3), (3, 2, 1, 0)) for turn in range(4)]
)
_HALF_MARKER_M = MARKER_HALF_M * 96 / 128  # without its quiet zone
_PLATE_X_M, _PLATE_Y_M, _PLATE_Z_M = 0.019, 0.035, 0.027 - TCP_OFFSET_M


@dataclass(frozen=True, slots=True)
class Marker:
    """Corners [px], shape (4, 2), clockwise as printed."""

    identity: int
    corners: Matrix

    @property
    def middle(self) -> Vector:
        """The crossing of its diagonals [px]: its middle however oblique the view."""
        one, other = self.corners[2] - self.corners[0], self.corners[3] - self.corners[1]
        apart = self.corners[1] - self.corners[0]
        crossed = one[0] * other[1] - one[1] * other[0]
        along = (apart[0] * other[1] - apart[1] * other[0]) / crossed
        return np.asarray(self.corners[0] + along * one)


class MarkerFinder:
    """Finds markers of the dictionary 4x4_50."""

    def __init__(self) -> None:
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        parameters.cornerRefinementWinSize = 3
        parameters.adaptiveThreshWinSizeMin = 7
        parameters.adaptiveThreshWinSizeMax = 15
        parameters.adaptiveThreshWinSizeStep = 8
        parameters.minMarkerPerimeterRate = _LEAST_PERIMETER
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_4X4_50)
        self._detector = cv2.aruco.ArucoDetector(dictionary, parameters)
        self.edge_px = 0.0  # how wide the edges were in the last window

    def find(self, window: Window) -> list[Marker]:
        """The markers in a window of a BGR image."""
        grey = np.asarray(cv2.cvtColor(window.patch, cv2.COLOR_BGR2GRAY), np.uint8)
        corners, identities, _ = self._detector.detectMarkers(grey)
        if not corners:
            return []
        self.edge_px = _edge_width(grey)
        return [
            Marker(int(identity), window.corner + quad.reshape(4, 2).astype(float))
            for identity, quad in zip(identities.ravel(), corners, strict=True)
        ]


def _edge_width(grey: Image) -> float:
    """Width of the steepest edges [px]: their contrast over their steepness."""
    across = cv2.Sobel(grey, cv2.CV_16S, 1, 0)
    counts = level_counts(grey)
    low, high = percentile(counts, 0.05), percentile(counts, 0.95)
    steep = np.abs(across).ravel()
    count = max(1, steep.size // 150)
    return float((high - low) / max(1.0, float(np.partition(steep, -count)[-count]) / 8))


def percentile(counts: NDArray[np.int64], part: float) -> float:
    """As numpy's: the grey level below which `part` of the pixels lie, between two if need be."""
    reached = np.cumsum(counts)
    place = float(reached[-1] - 1) * part
    below = int(place)
    lower, upper = (int(level) for level in np.searchsorted(reached, (below, below + 1), "right"))
    apart, beyond = upper - lower, place - below
    return lower + apart * beyond if beyond < 0.5 else upper - apart * (1 - beyond)


def gripper_faces() -> list[Matrix]:
    """Corners of the three gripper markers in the tool's frame [m], shape (4, 3) each.

    In the order of `FACES`.
    """
    half = _HALF_MARKER_M
    square = np.array([(-half, -half), (half, -half), (half, half), (-half, half)])
    faces = [np.column_stack((np.full(4, _PLATE_X_M), square[:, 0], _PLATE_Z_M + square[:, 1]))]
    for y in (_PLATE_Y_M, -_PLATE_Y_M):
        faces.append(np.column_stack((square[:, 0], np.full(4, y), _PLATE_Z_M + square[:, 1])))
    return faces


def match_face(
    view: str, marker: Marker, faces: list[Matrix], expected: list[Matrix], edge_px: float
) -> tuple[Sighting, float]:
    """The tool's sighting by the face and the order of corners that fit a gripper marker best.

    And how far [px] the whole lies from where it was expected. What is left of the corners once it
    has been shifted there is their measured error. `faces`: of each the corners in the tool's frame
    [m], shape (4, 3), in the order of `FACES`; `expected`: the same [px], shape (4, 2).
    """
    found = marker.corners[_ORDERS]
    gaps = found[None] - np.stack(expected)[:, None]
    shifts = gaps.sum(axis=2) / 4
    left = np.sqrt(((gaps - shifts[:, :, None]) ** 2).sum(axis=(2, 3)) / 8)
    shifted = np.hypot(shifts[..., 0], shifts[..., 1])
    face, order = np.unravel_index(np.argmin(left + _SHIFT_COSTS * shifted), left.shape)
    blurred = EDGE_JUDGEMENT * edge_px
    sighting = Sighting(
        view,
        Thing.TOOL,
        found[order],
        faces[face],
        sigma_px=math.hypot(_CORNER_PX, blurred),
        lasting_px=blurred,
        warp_px=math.hypot(float(left[face, order]), _SHRINKS * edge_px),
        cue=FACES[face],
    )
    return sighting, float(shifted[face, order])
