"""Reported packets over a sliding window: rate of delivery and share lost."""

from __future__ import annotations

from collections import Counter, deque
from collections.abc import Sequence

from tams_app.records import PacketArrival
from tams_app.units import NS_PER_S

_KEPT_NS = 2 * NS_PER_S
_WINDOW_NS = NS_PER_S
_ENOUGH = 30  # packets to distinguish 2 % from 10 % of loss
CLOCK_JUMP_NS = 2 * NS_PER_S  # arrivals further apart are of two clocks, or of two routes

_Key = tuple[str, int, int, int | None, int]


class Deliveries:
    """Each packet once, whatever is reported again.

    A packet that was commanded to be lost and arrives later counts as lost and as delivered.
    """

    def __init__(self) -> None:
        self._seen: set[_Key] = set()
        self._reported: deque[_Key] = deque()  # the same, in the order of the reports
        self._arrived: deque[tuple[int, int, int]] = deque()  # (arrival, sent, bytes) as reported
        self._fates: deque[tuple[int, int, bool]] = deque()  # (sent, bytes, lost) as reported
        self.newest_sent_ns = -1

    def take(self, arrivals: Sequence[PacketArrival]) -> list[PacketArrival]:
        """Those of `arrivals` that are new; what was sent 2 s before the newest is too old."""
        new = []
        alike: Counter[tuple[str, int, int, int | None]] = Counter()
        for packet in arrivals:
            alone = packet.view, packet.sent_ns, packet.size_bytes, packet.arrived_ns
            alike[alone] += 1  # packets of one frame may be reported with equal times
            key = (*alone, alike[alone])
            if key in self._seen or packet.sent_ns < self.newest_sent_ns - _KEPT_NS:
                continue
            self._seen.add(key)
            self._reported.append(key)
            self.newest_sent_ns = max(self.newest_sent_ns, packet.sent_ns)
            new.append(packet)
        for packet in new:
            self._fates.append((packet.sent_ns, packet.size_bytes, packet.arrived_ns is None))
            if packet.arrived_ns is not None:
                if self._arrived and abs(packet.arrived_ns - self._arrived[-1][0]) > CLOCK_JUMP_NS:
                    self._arrived.clear()
                self._arrived.append((packet.arrived_ns, packet.sent_ns, packet.size_bytes))
        self._trim()
        return new

    def _trim(self) -> None:
        while self._fates and self._fates[0][0] < self.newest_sent_ns - _WINDOW_NS:
            self._fates.popleft()
        while self._arrived and self._arrived[0][0] < self._arrived[-1][0] - _WINDOW_NS:
            self._arrived.popleft()
        while self._reported and self._reported[0][1] < self.newest_sent_ns - _KEPT_NS:
            self._seen.discard(self._reported.popleft())

    def forget_arrivals(self) -> None:
        """Begin anew after a gap, over which no rate means anything."""
        self._arrived.clear()

    def loss(self) -> float:
        """The share of the packets of the last second that are lost; 0 if they are too few."""
        if len(self._fates) < _ENOUGH:
            return 0.0
        return sum(lost for *_, lost in self._fates) / len(self._fates)

    def reported_bytes(self, after_ns: int, until_ns: int) -> int:
        """Bytes of known fate, arrived or lost, of those sent in that part of the last second."""
        return sum(size for sent_ns, size, _ in self._fates if after_ns < sent_ns <= until_ns)

    def rate_kbps(self, window_ns: int) -> float:
        """The rate of arrivals in at least the last `window_ns`, from one arrival to another."""
        if not self._arrived:
            return 0.0
        end_ns = max(arrived_ns for arrived_ns, *_ in self._arrived)
        cut_ns = end_ns - window_ns
        total = sum(size for arrived_ns, _, size in self._arrived if arrived_ns > cut_ns)
        earlier = (arrived_ns for arrived_ns, *_ in self._arrived if arrived_ns <= cut_ns)
        return total * 8e6 / (end_ns - max(earlier, default=cut_ns))

    def rate_of_kbps(self, after_ns: int, until_ns: int) -> float:
        """The rate at which arrived what was sent then, from the arrival before it to its last."""
        before_ns = max((a for a, sent_ns, _ in self._arrived if sent_ns <= after_ns), default=None)
        sizes = [(a, size) for a, sent, size in self._arrived if after_ns < sent <= until_ns]
        if before_ns is None or not sizes:
            return 0.0
        time_ns = max(arrived_ns for arrived_ns, _ in sizes) - before_ns
        return sum(size for _, size in sizes) * 8e6 / time_ns if time_ns > 0 else 0.0
