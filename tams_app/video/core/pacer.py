"""The pacer: a frame's packets leave a little faster than the uplink carries them, not in a burst.

A burst waits at the bottleneck all the same, where it delays the state of the arm, and overflows
the queue when the capacity falls; and of its packets only the first says how long the queue was.
Where the estimate is at the most that it may be, the uplink may carry anything beyond, and a frame
that was paced would only be later.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import AbstractContextManager, nullcontext

from tams_app.units import NS_PER_MS

_FASTER = 1.5  # pacing rate / estimated capacity; drains the queue if that is too low
_LEAST_KBPS = 200.0  # what views and padding send in an outage, when the estimate is next to none
_AT_ONCE_KBPS = 1e9  # a frame takes less than a microsecond
_PART_NS = 5 * NS_PER_MS  # leave at once: waking for each packet would cost more than it gives


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

    def reserve(self, now_ns: int, size_bytes: int) -> int:
        """When a part of this size may leave [ns], behind all that have asked before."""
        with self._lock:
            leaves_ns = max(now_ns, self._free_ns)
            self._free_ns = leaves_ns + round(size_bytes * 8e6 / self._kbps)
            return leaves_ns

    def waiting_bytes(self, now_ns: int) -> float:
        """What has asked and may not have left."""
        return max(0, self._free_ns - now_ns) * self._kbps / 8e6
