"""The place of each captured frame on its camera's fixed time grid."""

from __future__ import annotations

from tams_app.runtime.clock import NS_PER_S

# A frame keeps its turn until it is this many periods off its place: more than half a period, so
# that jitter around the middle between two places does not drop and skip frames in turn.
_TOLERANCE = 0.75


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
        self.missed = 0  # places that stayed empty

    def index(self, capture_ns: int) -> int | None:
        """The index of the frame captured at `capture_ns`; None if its place is taken."""
        if self._last < 0:
            self._first_ns = self._last_ns = capture_ns
            self._last = 0
            return 0
        place = (capture_ns - self._first_ns) * self._fps / NS_PER_S
        periods = (capture_ns - self._last_ns) * self._fps / NS_PER_S
        index = self._last + max(1, round(periods))
        if abs(place - index) > _TOLERANCE:
            index = round(place)
        self._last_ns = capture_ns  # also of a frame left out: the next one comes a period later
        if index <= self._last:
            return None
        self.missed += index - self._last - 1
        self._last = index
        return index
