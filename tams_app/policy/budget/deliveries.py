"""Reported packets over a sliding window: rates of sending and delivery, share lost."""

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
        arrived = []
        for packet in new:
            self._fates.append((packet.sent_ns, packet.size_bytes, packet.arrived_ns is None))
            if packet.arrived_ns is not None:
                arrived.append((packet.arrived_ns, packet.sent_ns, packet.size_bytes))
        for one in sorted(arrived):
            if self._arrived and abs(one[0] - self._arrived[-1][0]) > CLOCK_JUMP_NS:
                self._arrived.clear()
            self._arrived.append(one)
        self._trim()
        return new

    def _trim(self) -> None:
        while self._fates and self._fates[0][0] < self.newest_sent_ns - _WINDOW_NS:
            self._fates.popleft()
        while self._arrived and self._arrived[0][0] < self._arrived[-1][0] - _WINDOW_NS:
            self._arrived.popleft()
        while self._reported and self._reported[0][1] < self.newest_sent_ns - _KEPT_NS:
            self._seen.discard(self._reported.popleft())

    def loss(self, window_ns: int = _WINDOW_NS) -> float:
        """The share lost of what was sent in the last second at most; 0 if it is too little."""
        since_ns = self.newest_sent_ns - window_ns
        fates = [lost for sent_ns, _, lost in self._fates if sent_ns > since_ns]
        return sum(fates) / len(fates) if len(fates) >= _ENOUGH else 0.0

    def rates_kbps(self, window_ns: int) -> tuple[float, float]:
        """The rate at which packets have arrived of late, and the one at which these were sent.

        It counts from one arrival to another, at least `window_ns` apart; where not even a third
        of that is known, both are 0. What was lost among them was sent as well. Feedback that is
        missing is missing in both.
        """
        if not self._arrived:
            return 0.0, 0.0
        end_ns = self._arrived[-1][0]
        arrived_bytes, sent_ns = 0, 0
        first_ns, first_sent_ns, size_bytes = self._arrived[-1]
        for first_ns, first_sent_ns, size_bytes in reversed(self._arrived):
            if first_ns <= end_ns - window_ns:
                break
            arrived_bytes += size_bytes
            sent_ns = max(sent_ns, first_sent_ns)
        else:
            arrived_bytes -= size_bytes
        if end_ns - first_ns < window_ns // 3 or sent_ns <= first_sent_ns:
            return 0.0, 0.0
        sent_bytes = sum(size for t, size, _ in self._fates if first_sent_ns < t <= sent_ns)
        elapsed_ns, sending_ns = end_ns - first_ns, sent_ns - first_sent_ns
        return arrived_bytes * 8e6 / elapsed_ns, sent_bytes * 8e6 / sending_ns

    def forget_arrivals(self) -> None:
        """Begin anew after a gap, over which no rate means anything."""
        self._arrived.clear()
