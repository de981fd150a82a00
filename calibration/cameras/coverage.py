"""Whether the views of a board suffice to find a lens, and what to show next."""

from __future__ import annotations

from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from calibration.cameras.board import BoardView

COLUMNS, ROWS = 5, 4  # fields of the image
FEWEST_VIEWS = 12
_FIELDS_NEEDED = 0.8
_TILT_DEG = 18.0
_FEWEST_TILTED = 2  # to each side
_SIMILAR = 0.03  # of the image's width, mean distance of the same corners
_DIRECTIONS = ("left", "right", "top", "bottom")


@dataclass(slots=True)
class Coverage:
    """The views taken so far of one camera with images of `width` x `height`."""

    width: int
    height: int
    views: list[BoardView] = field(default_factory=list)
    tilted: dict[str, int] = field(default_factory=lambda: dict.fromkeys(_DIRECTIONS, 0))
    covered: NDArray[np.bool_] = field(default_factory=lambda: np.zeros((ROWS, COLUMNS), bool))

    def offer(self, view: BoardView) -> str:
        """Take a view, or say why not: "" if it was taken."""
        if any(self._similar(view, other) for other in self.views):
            return "too similar to one taken: move the board, or tilt it"
        self.views.append(view)
        points = view.image_points[:, 0]
        columns = np.clip(points[:, 0] / self.width * COLUMNS, 0, COLUMNS - 1).astype(int)
        rows = np.clip(points[:, 1] / self.height * ROWS, 0, ROWS - 1).astype(int)
        self.covered[rows, columns] = True
        for direction in self._tilts(view):
            self.tilted[direction] += 1
        return ""

    @property
    def share(self) -> float:
        """Of the fields of the image that corners were in."""
        return float(self.covered.mean())

    def wanting(self) -> str:
        """What is still to be shown, "" when it suffices."""
        if self.share < _FIELDS_NEEDED:
            return f"hold the board to the {self._empty_part()} of the image"
        for direction, count in self.tilted.items():
            if count < _FEWEST_TILTED:
                return f"tilt the board: its {direction} edge away from the camera"
        if len(self.views) < FEWEST_VIEWS:
            return f"{FEWEST_VIEWS - len(self.views)} more views, nearer and farther"
        return ""

    def _similar(self, view: BoardView, other: BoardView) -> bool:
        mine, theirs = _by_corner(view), _by_corner(other)
        common = mine.keys() & theirs.keys()
        if not common:
            return False
        distance = np.mean([np.linalg.norm(mine[key] - theirs[key]) for key in common])
        return bool(distance < _SIMILAR * self.width)

    def _tilts(self, view: BoardView) -> list[str]:
        """Which edges are farther away than the others by a tilt that counts.

        A lens of a common webcam's width is good enough for that: focal length = image width.
        """
        nominal = np.array(
            [[self.width, 0, self.width / 2], [0, self.width, self.height / 2], [0, 0, 1.0]]
        )
        found, turn, _ = cv2.solvePnP(view.object_points, view.image_points, nominal, None)
        if not found:
            return []
        right, down, _ = Rotation.from_rotvec(turn.ravel()).as_matrix().T
        least = np.sin(np.radians(_TILT_DEG))
        depth_right, depth_down = float(right[2]), float(down[2])
        away = {
            "right": depth_right > least,
            "left": depth_right < -least,
            "bottom": depth_down > least,
            "top": depth_down < -least,
        }
        return [direction for direction, is_away in away.items() if is_away]

    def _empty_part(self) -> str:
        """Where most is missing, in words."""
        missing = np.argwhere(~self.covered)
        rows, columns = missing[:, 0], missing[:, 1]
        row, column = missing[np.argmax((rows - 1.5) ** 2 + (columns - 2.0) ** 2)]
        high = ("top", "", "", "bottom")[row]
        wide = ("left", "left", "", "right", "right")[column]
        return " ".join(filter(None, (high, wide))) or "middle"


def _by_corner(view: BoardView) -> dict[tuple[float, float], NDArray[np.float32]]:
    """Where each corner of the board [m] is in the image [px]."""
    return {
        (float(on_board[0, 0]), float(on_board[0, 1])): pixel[0]
        for on_board, pixel in zip(view.object_points, view.image_points, strict=True)
    }
