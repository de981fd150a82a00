"""A person who does at the cameras what `calibrate cameras` asks for, and how that looks."""

from __future__ import annotations

import math
from enum import Enum, auto

import cv2

from tams_app.records import Image
from tams_app.units import NS_PER_S

_SKIN = (120, 150, 205)  # BGR
_SCREEN_BLACK, _SCREEN_WHITE = 25.0, 215.0  # grey levels of the screen in an image
_GAMMA = 2.2


class Task(Enum):
    """What the person is asked to do; a simulated one does it."""

    REST = auto()  # keep out of sight, hold still
    WAVE = auto()  # a hand before one camera
    SHOW_SCREEN = auto()  # point it at the screen that flashes
    SHOW_BOARD = auto()  # hold the board before one camera, from many sides
    MOVE_ARM = auto()  # the board lies still, the arm goes to many poses
    MOVE_BOARD = auto()  # the board goes to another place


BOARD_TASKS = (Task.SHOW_BOARD, Task.MOVE_ARM, Task.MOVE_BOARD)


class CameraPerson:
    """Does what was asked last, and knows when it is finished; all of it in virtual time."""

    def __init__(self) -> None:
        self._task, self._view, self._since_ns = Task.REST, "", 0

    def ask(self, task: Task, view: str, now_ns: int) -> None:
        """Begin to do it for `view`, "" for all."""
        self._task, self._view, self._since_ns = task, view, now_ns

    def finished(self, now_ns: int) -> bool:
        """Whether what was asked is done; waving and resting have no end of their own."""
        return self._task is Task.SHOW_SCREEN

    def seen(
        self, view: str, scene: Image, start_ns: int, end_ns: int, lit_share: float | None
    ) -> Image:
        """What `view` sees in an exposure; `lit_share`: of it the screen is white, if there is one.

        The screen's light adds up over the exposure; grey levels do not.
        """
        middle_s = ((start_ns + end_ns) / 2 - self._since_ns) / NS_PER_S
        meant = self._view in ("", view)
        image = scene.copy()
        if self._task is Task.WAVE:
            _draw_hand(image, middle_s, 1.0 if meant else 0.12)
        elif self._task is Task.SHOW_SCREEN and meant and lit_share is not None:
            level = _SCREEN_BLACK + (_SCREEN_WHITE - _SCREEN_BLACK) * lit_share ** (1 / _GAMMA)
            image[40:-40, 40:-40] = round(level)
        return image


def _draw_hand(image: Image, after_s: float, size: float) -> None:
    height, width = image.shape[:2]
    centre = (
        int(width * (0.5 + 0.25 * math.sin(7.0 * after_s))),
        int(height * (0.5 + 0.1 * math.cos(5.0 * after_s))),
    )
    axes = (max(3, int(0.2 * size * width)), max(3, int(0.3 * size * height)))
    cv2.ellipse(image, centre, axes, 15 * math.sin(6 * after_s), 0, 360, _SKIN, -1)
