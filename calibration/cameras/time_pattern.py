"""A number on a screen that a camera can read: which refresh of the screen it saw.

Four ArUco markers at the corners give the screen's place in the image. Between them stand pairs
of squares, one white and one black, whose order is one bit: the difference of two neighbours needs
no threshold and no even light. The number is in Gray code (one bit changes at a time), so an image
exposed over two refreshes reads as one of the two and never as a third. So does a screen that is
redrawn just then, unless the parity pair stands on the other side of that line: it refuses the
image then, and most that are damaged otherwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from tams_app.records import Image

BITS = 16  # 18 minutes at 60 refreshes a second
COUNTS = 1 << BITS
COLUMNS, ROWS = 34, 20  # modules
_MARKER, _CELL = 6, 3  # modules, square
_MARKER_AT = ((1, 1), (27, 1), (27, 13), (1, 13))  # left, top [modules]; clockwise
_DICTIONARY = cv2.aruco.DICT_4X4_50
_FIRST_ID = 40  # away from the rig's own markers
_CELLS_AT = (8, 1)
_PAIRS_PER_ROW = 3
# Bits of low order change most often: they stand together, in rows that a rolling shutter reads
# soon after one another. 16 is the parity.
_ORDER = (15, 14, 13, 9, 8, 7, 2, 1, 0, 3, 4, 16, 6, 5, 10, 12, 11)
_PARITY = 16

_SAMPLE_PX = 6  # per module, of the straightened image
_LEAST_CONTRAST = 25.0  # grey levels between the black and the white of a pair
_CLEAR = 0.25  # of that contrast: below, a pair is in between
_MOST_UNCLEAR = 3  # pairs: two that change and the parity

Corners = NDArray[np.float32]


@dataclass(frozen=True, slots=True)
class Reading:
    """What one image says, or why it says nothing."""

    count: int  # -1 if not read
    reason: str  # "" if read
    unclear: int  # pairs caught between two refreshes
    width_px: float  # of the pattern in the image


class TimePattern:
    """Draws numbers with modules of `module_px` pixels; the image is BGR."""

    def __init__(self, module_px: int) -> None:
        self._module = module_px
        dictionary = cv2.aruco.getPredefinedDictionary(_DICTIONARY)
        blank = np.full((ROWS * module_px, COLUMNS * module_px), 255, np.uint8)
        for number, (left, top) in enumerate(_MARKER_AT):
            side = _MARKER * module_px
            marker = cv2.aruco.generateImageMarker(dictionary, _FIRST_ID + number, side)
            x, y = left * module_px, top * module_px
            blank[y : y + side, x : x + side] = marker
        self._blank = cv2.cvtColor(blank, cv2.COLOR_GRAY2BGR)

    @property
    def size(self) -> tuple[int, int]:
        """Width and height [px]."""
        return COLUMNS * self._module, ROWS * self._module

    def draw(self, count: int) -> Image:
        """The pattern that shows `count`, 0 to COUNTS-1; a new array."""
        image = self._blank.copy()
        code = gray_code(count)
        side = _CELL * self._module
        for place, bit in enumerate(_ORDER):
            one = bit_of(code, bit)
            x, y = (part * self._module for part in _pair_at(place))
            black = x if one else x + side
            image[y : y + side, black : black + side] = 0
        return np.asarray(image, np.uint8)


class PatternReader:
    """Finds and reads the pattern in images."""

    def __init__(self) -> None:
        parameters = cv2.aruco.DetectorParameters()
        parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
        parameters.minMarkerPerimeterRate = 0.02
        self._detector = cv2.aruco.ArucoDetector(
            cv2.aruco.getPredefinedDictionary(_DICTIONARY), parameters
        )

    def read(self, image: Image) -> Reading:
        """Read one BGR image; never raises for what it shows."""
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        corners, ids, _ = self._detector.detectMarkers(grey)
        known = _known_markers(corners, ids)
        if len(known) < 2:
            return Reading(
                -1,
                f"{len(known)} of its 4 corners are seen: show all of the screen, nearer",
                0,
                0.0,
            )
        to_image = _homography(known)
        if to_image is None:
            return Reading(-1, "the corners seen do not fit one screen", 0, 0.0)
        scale = np.diag([1 / _SAMPLE_PX, 1 / _SAMPLE_PX, 1.0])
        straight = cv2.warpPerspective(
            grey,
            to_image @ scale,
            (COLUMNS * _SAMPLE_PX, ROWS * _SAMPLE_PX),
            flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        )
        return _decode(np.asarray(straight, np.uint8), _width(to_image))


def gray_code(count: int) -> int:
    """The reflected binary code of `count` (Gray, US patent 2632058)."""
    return count ^ (count >> 1)


def from_gray_code(code: int) -> int:
    """The number that `code` stands for."""
    count = 0
    while code:
        count ^= code
        code >>= 1
    return count


def bit_of(code: int, bit: int) -> int:
    """Bit `bit` of a code, or its parity."""
    return code.bit_count() & 1 if bit == _PARITY else code >> bit & 1


def _pair_at(place: int) -> tuple[int, int]:
    """Left and top of a pair [modules]."""
    left, top = _CELLS_AT
    row, column = divmod(place, _PAIRS_PER_ROW)
    return left + column * 2 * _CELL, top + row * _CELL


def _known_markers(corners: Sequence[Any], ids: Any | None) -> dict[int, Corners]:
    found: dict[int, Corners] = {}
    for marker, identity in zip(corners, ids.ravel() if ids is not None else (), strict=True):
        number = int(identity) - _FIRST_ID
        if 0 <= number < len(_MARKER_AT):
            found[number] = marker.reshape(4, 2)
    return found


def _homography(known: dict[int, Corners]) -> NDArray[np.float64] | None:
    """From modules to pixels, from all corners of all markers seen."""
    square = np.array([(0, 0), (_MARKER, 0), (_MARKER, _MARKER), (0, _MARKER)], np.float64)
    modules = np.vstack([square + _MARKER_AT[number] for number in known])
    pixels = np.vstack([known[number] for number in known]).astype(np.float64)
    found, _ = cv2.findHomography(modules, pixels, cv2.RANSAC, 3.0)
    return None if found is None else np.asarray(found, np.float64)


def _width(to_image: NDArray[np.float64]) -> float:
    edge = np.array([[[0.0, ROWS / 2]], [[float(COLUMNS), ROWS / 2]]])
    left, right = cv2.perspectiveTransform(edge, to_image)[:, 0]
    return float(np.linalg.norm(right - left))


def _decode(straight: Image, width_px: float) -> Reading:
    bits, strengths = np.zeros(len(_ORDER), int), np.zeros(len(_ORDER))
    for place, bit in enumerate(_ORDER):
        x, y = _pair_at(place)
        bits[bit], strengths[bit] = _pair(straight, x, y)
    contrast = float(np.percentile(strengths, 75))
    if contrast < _LEAST_CONTRAST:
        return Reading(-1, "the screen is too pale or too bright to read", 0, width_px)
    unclear = strengths < _CLEAR * contrast
    count_unclear = int(unclear.sum())
    if count_unclear > _MOST_UNCLEAR:
        return Reading(
            -1,
            f"{count_unclear} squares are in between: a shorter exposure, or a sharper image",
            count_unclear,
            width_px,
        )
    code = sum(int(bits[bit]) << bit for bit in range(BITS))
    if bits[_PARITY] != bit_of(code, _PARITY) and count_unclear == 0:
        return Reading(-1, "its parity is wrong", count_unclear, width_px)
    return Reading(from_gray_code(code), "", count_unclear, width_px)


def _pair(straight: Image, column: int, row: int) -> tuple[int, float]:
    """The bit, and how far its two squares differ [grey levels]; their middles only."""
    side, margin = _CELL * _SAMPLE_PX, _SAMPLE_PX
    top, left = row * _SAMPLE_PX, column * _SAMPLE_PX
    inner = slice(top + margin, top + side - margin)
    first = float(straight[inner, left + margin : left + side - margin].mean())
    second = float(straight[inner, left + side + margin : left + 2 * side - margin].mean())
    return int(first < second), abs(first - second)
