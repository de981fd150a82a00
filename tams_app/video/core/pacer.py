"""What may leave, and when: the pacer, and the bound on what is in flight.

A frame's packets leave a little faster than the uplink carries them, not in a burst. A burst waits
at the bottleneck all the same, where it delays the state of the arm, and overflows the queue when
the capacity falls; and of its packets only the first says how long the queue was. Where the
estimate is at the most that it may be, the uplink may carry anything beyond, and a frame that was
paced would only be later.

Where more than a bound is in flight, views leave frames out. Bytes in flight are those that were
sent after the newest packet that any receiver has reported: all views leave by one queue, so what
was sent before it has arrived or is lost, also where the message that reported it was lost itself.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable, Mapping, Sequence
from contextlib import AbstractContextManager, nullcontext

from tams_app.units import NS_PER_MS

_FASTER = 1.5  # pacing rate / estimated capacity; drains the queue if that is too low
_LEAST_KBPS = 200.0  # what views and padding send in an outage, when the estimate is next to none
_AT_ONCE_KBPS = 1e9  # a frame takes less than a microsecond
_PART_NS = 5 * NS_PER_MS  # leave at once: waking for each packet would cost more than it gives
# A quarter of the bound is half of the delay target, or one frame of each view.
_PRIMARY_EXCESS = 0.25
# Every view keeps four frames a second, whatever is in flight: a way back that is dead must not
# stop the picture, and after an outage the first frame is there without being asked for.
LONGEST_WAIT_NS = 250 * NS_PER_MS
_KEPT = 1024


class Pacer:
    """When the packets of all views leave, in the order in which they ask."""

    def __init__(
        self,
        capacity_kbps: float,
        most_kbps: float = math.inf,
        lock: AbstractContextManager[object] | None = None,
    ) -> None:
        """`capacity_kbps`: the estimate until the first `set`; it never exceeds `most_kbps`.

        With a `lock` any thread may ask.
        """
        self._lock = nullcontext() if lock is None else lock
        self._most_kbps = most_kbps
        self._free_ns = 0
        self.set(capacity_kbps)

    def set(self, capacity_kbps: float) -> None:
        """From now on the uplink is believed to carry so much."""
        paced_kbps = _FASTER * max(capacity_kbps, _LEAST_KBPS / _FASTER)
        self._kbps = paced_kbps if capacity_kbps < self._most_kbps else _AT_ONCE_KBPS

    def parts(self, sizes_bytes: Sequence[int]) -> list[slice]:
        """Divide a frame's packets, of these sizes, into parts that leave at once."""
        most_bytes = self._kbps * _PART_NS / 8e6
        parts, begin, part_bytes = [], 0, 0
        for place, size_bytes in enumerate(sizes_bytes):
            if place > begin and part_bytes + size_bytes > most_bytes:
                parts.append(slice(begin, place))
                begin, part_bytes = place, 0
            part_bytes += size_bytes
        return [*parts, slice(begin, len(sizes_bytes))] if sizes_bytes else []

    def schedule(self, now_ns: int, sizes_bytes: Sequence[int]) -> list[tuple[int, slice]]:
        """When each part of a frame's packets may leave [ns]: the frame asks now."""
        return [
            (self.reserve(now_ns, sum(sizes_bytes[part])), part) for part in self.parts(sizes_bytes)
        ]

    def reserve(self, now_ns: int, size_bytes: int) -> int:
        """When a part of this size may leave [ns], behind all that have asked before."""
        with self._lock:
            leaves_ns = max(now_ns, self._free_ns)
            self._free_ns = leaves_ns + round(size_bytes * 8e6 / self._kbps)
            return leaves_ns

    def waiting_bytes(self, now_ns: int) -> float:
        """What has asked and may not have left."""
        return max(0, self._free_ns - now_ns) * self._kbps / 8e6


def view_limits(limit_bytes: float, target_kbps: Mapping[str, float]) -> dict[str, float]:
    """For each view how much may be in flight when one of its frames is captured.

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

    def __init__(
        self, views: Iterable[str], lock: AbstractContextManager[object] | None = None
    ) -> None:
        """With a `lock` any thread may ask."""
        self._lock = nullcontext() if lock is None else lock
        self._limit_bytes = self._room_bytes = math.inf
        self._limits = dict.fromkeys(views, math.inf)
        self._kept_ns: dict[str, int] = {}  # by view, the last frame that was not left out
        # (time, bytes sent before it); it reaches back ten seconds, as nothing in flight does
        self._sent: deque[tuple[int, int]] = deque(maxlen=_KEPT)

    def set(self, limit_bytes: float, target_kbps: Mapping[str, float]) -> None:
        """From now on so much may be in flight, for views with these targets."""
        with self._lock:
            self._limit_bytes = limit_bytes
            self._limits = view_limits(limit_bytes, target_kbps)

    def exceeded(
        self, view: str, now_ns: int, sent_bytes: int, reported_ns: int, waiting_bytes: float = 0.0
    ) -> bool:
        """True if a frame of `view` that was captured now is left out.

        In flight is what left between the first call after `reported_ns` and this one: less than
        the truth by at most what leaves between two calls.

        Args:
            view: its name.
            now_ns: the time; it never decreases.
            sent_bytes: that have left so far.
            reported_ns: when the newest packet left that a receiver has reported.
            waiting_bytes: what the pacer keeps back.
        """
        with self._lock:
            self._sent.append((now_ns, sent_bytes))
            while self._sent[0][0] < reported_ns and len(self._sent) > 1:
                self._sent.popleft()
            in_flight = sent_bytes - self._sent[0][1] + waiting_bytes
            self._room_bytes = self._limit_bytes - in_flight
            late = now_ns - self._kept_ns.get(view, now_ns) >= LONGEST_WAIT_NS
            if in_flight > self._limits[view] and view in self._kept_ns and not late:
                return True
            self._kept_ns[view] = now_ns
            return False

    def admits_retransmission(self, size_bytes: int) -> bool:
        """True if a packet may be sent again: within the bound, where a queue has lost many."""
        with self._lock:
            admitted = self._room_bytes >= size_bytes
            if admitted:  # until the next frame shows what has left
                self._room_bytes -= size_bytes
            return admitted
