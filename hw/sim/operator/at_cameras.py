"""A person who does at the cameras what `calibrate cameras` asks for, and how that looks."""

from __future__ import annotations

import math
from enum import Enum, auto

import cv2
import numpy as np

from tams_app.records import Image
from tams_app.units import NS_PER_S

_SKIN = (120, 150, 205)  # BGR
_RING_S = 9.0
_START_BLUR_PX = 4.0
_SCREEN_BLACK, _SCREEN_WHITE = 25.0, 215.0  # grey levels of the screen in an image
_GAMMA = 2.2


class Task(Enum):
    """What the person is asked to do; a simulated one does it."""

    REST = auto()  # keep out of sight, hold still
    WAVE = auto()  # a hand before one camera
    FOCUS = auto()  # turn its ring until the bar is highest
    SHOW_SCREEN = auto()  # point it at the screen that flashes
    SHOW_BOARD = auto()  # hold the board before one camera, from many sides
    MOVE_ARM = auto()  # the board lies still, the arm goes to many poses
    MOVE_BOARD = auto()  # the board goes to another place


BOARD_TASKS = (Task.SHOW_BOARD, Task.MOVE_ARM, Task.MOVE_BOARD)


class CameraPerson:
    """Does what was asked last, and knows when it is finished; all of it in virtual time."""

    def __init__(self, sharpest_px: dict[str, float]) -> None:
        """By view: the blur that is left when the ring stands right."""
        self._sharpest_px = sharpest_px
        self._blur_px = dict.fromkeys(sharpest_px, _START_BLUR_PX)
        # by view: blur, scene, and the scene blurred
        self._behind: dict[str, tuple[float, Image, Image]] = {}
        self._task, self._view, self._since_ns = Task.REST, "", 0

    def ask(self, task: Task, view: str, now_ns: int) -> None:
        """Begin to do it for `view`, "" for all."""
        self._task, self._view, self._since_ns = task, view, now_ns
        if task in BOARD_TASKS:  # a camera has been focused before a board is shown to it
            self._blur_px |= self._sharpest_px

    def finished(self, now_ns: int) -> bool:
        """Whether what was asked is done; what has no end of its own never is."""
        after_s = (now_ns - self._since_ns) / NS_PER_S
        return self._task is Task.SHOW_SCREEN or (self._task is Task.FOCUS and after_s >= _RING_S)

    def seen(
        self, view: str, scene: Image, start_ns: int, end_ns: int, lit_share: float | None
    ) -> Image:
        """What `view` sees in an exposure; `lit_share`: of it the screen is white, if there is one.

        The screen's light adds up over the exposure; grey levels do not.
        """
        middle_s = ((start_ns + end_ns) / 2 - self._since_ns) / NS_PER_S
        meant = self._view in ("", view)
        if self._task is Task.FOCUS and view == self._view:
            self._blur_px[view] = self._ring(view, middle_s)
        image = self._blurred(view, scene)
        if self._task is Task.WAVE:
            _draw_hand(image, middle_s, 1.0 if meant else 0.12)
        elif self._task is Task.SHOW_SCREEN and meant and lit_share is not None:
            level = _SCREEN_BLACK + (_SCREEN_WHITE - _SCREEN_BLACK) * lit_share ** (1 / _GAMMA)
            image[40:-40, 40:-40] = round(level)
        return image

    def _blurred(self, view: str, scene: Image) -> Image:
        """A new image of the scene, as sharp as the ring stands."""
        blur_px, known = self._blur_px[view], self._behind.get(view)
        if known is None or known[0] != blur_px or known[1] is not scene:
            blurred = scene if blur_px < 0.3 else cv2.GaussianBlur(scene, (0, 0), blur_px)
            known = self._behind[view] = blur_px, scene, np.asarray(blurred, np.uint8)
        return known[2].copy()

    def _ring(self, view: str, after_s: float) -> float:
        """Turned through the best place to the other end, and back to where the bar was highest."""
        best = self._sharpest_px[view]
        if after_s < _RING_S / 3:
            return best + (_START_BLUR_PX - best) * (1 - 3 * after_s / _RING_S)
        if after_s < 2 * _RING_S / 3:
            return best + 2.0 * math.sin(math.pi * (3 * after_s / _RING_S - 1))
        return best


def _draw_hand(image: Image, after_s: float, size: float) -> None:
    height, width = image.shape[:2]
    centre = (
        int(width * (0.5 + 0.25 * math.sin(7.0 * after_s))),
        int(height * (0.5 + 0.1 * math.cos(5.0 * after_s))),
    )
    axes = (max(3, int(0.2 * size * width)), max(3, int(0.3 * size * height)))
    cv2.ellipse(image, centre, axes, 15 * math.sin(6 * after_s), 0, 360, _SKIN, -1)
