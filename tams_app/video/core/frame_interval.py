"""The time between a camera's frames as it is, not as it was asked for.

Cameras take longer exposures in dim light, and a busy machine misses frames.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from tams_app.units import NS_PER_MS

# Cameras are asked for 5 to 60 frames a second; with room for jitter. Frames that are rarer get no
# more bits: those of three views, taken at once, fill the queue of 150 ms in front of a bottleneck.
SHORTEST_NS, LONGEST_NS = 10 * NS_PER_MS, 250 * NS_PER_MS
_REMEMBERED = 3  # the least whose median one missed frame does not move
_PAID = 1.5  # usual intervals that a frame may be as large as
_COUNTED = 2.0  # usual intervals that may pass before it: one frame was missed
_FREEZE_NS = 200 * NS_PER_MS
_FREEZE_INTERVALS = 2.5  # two frames in a row are missing


@dataclass(frozen=True, slots=True)
class FrameTime:
    """The time before one frame [ns].

    Attributes:
        elapsed_ns: since the frame before, within `SHORTEST_NS` and `LONGEST_NS`.
        usual_ns: the median of the last three of these: one missed frame does not move it, and a
            camera that changes its rate is followed from its second interval on.
    """

    elapsed_ns: int
    usual_ns: int

    @property
    def paid_ns(self) -> int:
        """Time the frame may take on the link: never more than has passed, so no queue grows.

        At most one and a half usual intervals: after a gap the frame is not as large as the gap.
        """
        return min(self.elapsed_ns, round(_PAID * self.usual_ns))

    @property
    def counted_ns(self) -> int:
        """Time towards a view's rate: one missed frame is made up for, a gap is not."""
        return min(self.elapsed_ns, round(_COUNTED * self.usual_ns))


def freeze_ns(usual_ns: int) -> int:
    """A shown frame that stays longer is a freeze, where frames are usually `usual_ns` apart."""
    return max(_FREEZE_NS, round(_FREEZE_INTERVALS * usual_ns))


class FrameIntervals:
    """Watches the times of one view's frames."""

    def __init__(self, first_ns: int) -> None:
        """`first_ns`: what counts as the time before the first frame."""
        self._first_ns = first_ns
        self._last_ns: int | None = None
        self._recent: deque[int] = deque(maxlen=_REMEMBERED)

    def step(self, capture_ns: int) -> FrameTime:
        if self._last_ns is not None:
            elapsed_ns = capture_ns - self._last_ns
            self._recent.append(min(max(elapsed_ns, SHORTEST_NS), LONGEST_NS))
        self._last_ns = capture_ns
        if not self._recent:
            return FrameTime(self._first_ns, self._first_ns)
        usual_ns = sorted(self._recent)[len(self._recent) // 2]
        return FrameTime(self._recent[-1], usual_ns)
