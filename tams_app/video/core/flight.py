"""The bound on what is under way: which views leave frames out when it is exceeded.

Bytes under way are those that were sent after the newest packet that any receiver has reported: all
views leave by one queue, so what was sent before it has arrived or is lost, also where the message
that reported it was lost itself.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping

from tams_app.units import NS_PER_MS

# A quarter of the bound is half of the delay target, or one frame of each view.
_PRIMARY_EXCESS = 0.25
# Every view keeps four frames a second, whatever is under way: a way back that is dead must not
# stop the picture, and after an outage the first frame is there without being asked for.
LONGEST_WAIT_NS = 250 * NS_PER_MS
_KEPT = 1024


def view_limits(limit_bytes: float, target_kbps: Mapping[str, float]) -> dict[str, float]:
    """For each view how much may be under way when one of its frames is captured.

    The view with the smallest target gives way first, at `limit_bytes`, that with the largest
    last; views whose targets are equal give way together.
    """
    steps = sorted(set(target_kbps.values()))
    places = {kbps: place / max(len(steps) - 1, 1) for place, kbps in enumerate(steps)}
    return {
        view: limit_bytes * (1.0 + _PRIMARY_EXCESS * places[kbps])
        for view, kbps in target_kbps.items()
    }


class FlightBound:
    """Asked before each frame whether it is left out, and before a packet is sent again."""

    def __init__(self, views: Iterable[str]) -> None:
        self._limit_bytes = self._room_bytes = math.inf
        self._limits = dict.fromkeys(views, math.inf)
        self._kept_ns: dict[str, int] = {}  # by view, the last frame that was not left out
        # (time, bytes sent before it); it reaches back ten seconds, as nothing under way does
        self._sent: deque[tuple[int, int]] = deque(maxlen=_KEPT)

    def set(self, limit_bytes: float, target_kbps: Mapping[str, float]) -> None:
        """From now on so much may be under way, for views with these targets."""
        self._limit_bytes = limit_bytes
        self._limits = view_limits(limit_bytes, target_kbps)

    def exceeded(
        self, view: str, now_ns: int, sent_bytes: int, reported_ns: int, waiting_bytes: float = 0.0
    ) -> bool:
        """True if a frame of `view` that was captured now is left out.

        Under way is what left between the first call after `reported_ns` and this one: less than
        the truth by at most what leaves between two calls.

        Args:
            view: its name.
            now_ns: the time; it never decreases.
            sent_bytes: that have left so far.
            reported_ns: when the newest packet left that a receiver has reported.
            waiting_bytes: what the pacer keeps back.
        """
        self._sent.append((now_ns, sent_bytes))
        while self._sent[0][0] < reported_ns and len(self._sent) > 1:
            self._sent.popleft()
        under_way = sent_bytes - self._sent[0][1] + waiting_bytes
        self._room_bytes = self._limit_bytes - under_way
        late = now_ns - self._kept_ns.get(view, now_ns) >= LONGEST_WAIT_NS
        if under_way > self._limits[view] and view in self._kept_ns and not late:
            return True
        self._kept_ns[view] = now_ns
        return False

    def admits_resend(self, size_bytes: int) -> bool:
        """True if a packet may be sent again: within the bound, where a queue has lost many."""
        admitted = self._room_bytes >= size_bytes
        if admitted:  # until the next frame shows what has left
            self._room_bytes -= size_bytes
        return admitted
