"""Judgement of a camera's frames: their place on the time grid, and freezes.

Pure: times and bytes go in, no thread and no clock.
"""

from __future__ import annotations

import zlib
from collections import deque
from enum import StrEnum

from tams_app.units import NS_PER_MS, NS_PER_S

SILENCE_NS = 500 * NS_PER_MS  # without a frame: frozen
REPETITION_NS = NS_PER_S  # without a frame that was not shown before: opened again
REMEMBERED = 8  # frames; drivers take turns with about four buffers
START_TIMEOUT_NS = 3 * NS_PER_S  # a USB camera takes its time to the first frame
# A frame keeps its turn until it is this many periods off its place: more than half a period, so
# that jitter around the middle between two places does not drop and skip frames in turn.
_GRID_TOLERANCE = 0.75


class CaptureGrid:
    """Gives frames their indices: `fps` places a second from the first frame on, never reused.

    A frame is as many places after the one before as periods have passed between them. No
    camera's clock is exact: once its frames are three quarters of a period off their places, one
    is left out (a fast camera) or one place stays empty (a slow one).
    """

    def __init__(self, fps: int) -> None:
        self._fps = fps
        self._first_ns = 0
        self._last_ns = 0
        self._last = -1

    def index(self, capture_ns: int) -> int | None:
        """The index of the frame captured at `capture_ns`; None if its place is taken."""
        if self._last < 0:
            self._first_ns = self._last_ns = capture_ns
            self._last = 0
            return 0
        place = (capture_ns - self._first_ns) * self._fps / NS_PER_S
        periods = (capture_ns - self._last_ns) * self._fps / NS_PER_S
        index = self._last + max(1, round(periods))
        if abs(place - index) > _GRID_TOLERANCE:
            index = round(place)
        self._last_ns = capture_ns  # also of a frame left out: the next one comes a period later
        if index <= self._last:
            return None
        self._last = index
        return index


class FrameStatus(StrEnum):
    """The status of an open camera by its newest frame, or by its absence."""

    NEW = "new"
    SILENT = "delivers no frames"
    REPEATED = "showed a frame again"
    FROZEN = "repeats one frame to the last bit"


class FreezeWatch:
    """Watches one camera over its re-openings; `noisy`: no two of its frames can be the same."""

    def __init__(self, noisy: bool) -> None:
        self._noisy = noisy
        self._recent: deque[int] = deque(maxlen=REMEMBERED)  # checksums of different frames
        self._changed_ns = 0
        self._seen_ns = 0
        self._timeout_ns = START_TIMEOUT_NS

    def opened(self, now_ns: int) -> None:
        """The camera was opened (again); its first frame may take a while.

        What it showed before is kept: one that repeats itself still does so after re-opening. But
        it gets the time for a new frame: the first ones may be left over from before.
        """
        self._seen_ns = self._changed_ns = now_ns
        self._timeout_ns = START_TIMEOUT_NS

    def frame(self, now_ns: int, frame: bytes | memoryview) -> FrameStatus:
        """A frame came, at `now_ns`; show it as a new one only if NEW.

        A sensor has noise, so a frame that comes again to the last bit is an old one, at once:
        then the age of what was shown last grows from here on. FROZEN: open the camera again.
        """
        self._seen_ns = now_ns
        self._timeout_ns = SILENCE_NS
        if not self._noisy:
            return FrameStatus.NEW
        checksum = zlib.crc32(frame)  # a collision costs one good frame in years
        if checksum not in self._recent:
            self._recent.append(checksum)
            self._changed_ns = now_ns
            return FrameStatus.NEW
        return (
            FrameStatus.FROZEN
            if now_ns - self._changed_ns > REPETITION_NS
            else FrameStatus.REPEATED
        )

    def silent_from_ns(self) -> int:
        """The time [ns] from which the camera counts as silent if no frame comes before."""
        return self._seen_ns + self._timeout_ns
