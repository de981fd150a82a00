"""Whether an image hangs: the hand moves, and nothing in it does."""

from __future__ import annotations

import cv2
import numpy as np

from tams_app.records import Image
from tams_app.runtime.clock import NS_PER_MS

_SMALL = (160, 120)
_CHANGE = 10  # grey levels; codec flicker of a still image stays below
_PLACES = 8  # of the small image
_HANGS_AFTER_M = 0.012  # asked of the tool meanwhile
_TRIES_AGAIN_NS = 2_000 * NS_PER_MS  # nothing moves because he holds still: he gives it a chance


class StillnessWatch:
    """Watches one view; an image in which nothing moves counts as hanging after a while."""

    def __init__(self) -> None:
        self._last: Image | None = None
        self._path_m = 0.0
        self._since_ns = 0

    def hangs(self, now_ns: int, image: Image, asked_m: float) -> bool:
        """`asked_m`: how far the tool was asked to move since the last look, as it should show."""
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        small = np.asarray(cv2.resize(grey, _SMALL, interpolation=cv2.INTER_AREA), np.uint8)
        last, self._last = self._last, small
        if last is None or _moved(last, small):
            self._path_m, self._since_ns = 0.0, now_ns
            return False
        if asked_m > 0.0:
            self._path_m += asked_m
            if self._path_m < _HANGS_AFTER_M:
                self._since_ns = now_ns
        elif now_ns - self._since_ns > _TRIES_AGAIN_NS:
            self._path_m, self._since_ns = 0.0, now_ns
        return self._path_m >= _HANGS_AFTER_M


def _moved(one: Image, other: Image) -> bool:
    return int(np.count_nonzero(cv2.absdiff(one, other) > _CHANGE)) >= _PLACES
