"""The queueing delay of an uplink, from one-way delays on two unsynchronised clocks."""

from __future__ import annotations

from collections import deque
from itertools import pairwise
from statistics import median

from tams_app.policy.budget.deliveries import CLOCK_JUMP_NS
from tams_app.units import NS_PER_MS, NS_PER_S

_LEVEL_NS = 60 * NS_PER_MS  # longer than a frame period: some packet in it found little jitter
_BASE_NS = 10 * NS_PER_S  # 100 ppm of drift are 1 ms in it
_NOISE_STEPS = 2.0  # median steps between levels without a queue that the level exceeds the base by
_NOISE_MAX_NS = 25 * NS_PER_MS


class QueueingDelay:
    """Level over base: the smallest delay of the last 60 ms over the smallest one of 10 s.

    Jitter delays single packets, and where order is kept also those behind them, so a single delay
    says little. Even the level lies above the base by the jitter; that part is taken off, estimated
    from how much the level changes from one window to the next, which a standing queue does not
    affect. The clocks' offset is in level and base alike.
    """

    def __init__(self) -> None:
        self._recent: deque[tuple[int, int]] = deque()  # (arrival, delay) with ascending delays
        self._windows: deque[tuple[int, int]] = deque()  # (window, its smallest delay)
        self._first_ns = 0  # arrivals are counted from it, so that windows know no clock
        self._newest_ns: int | None = None

    def add(self, sent_ns: int, arrived_ns: int) -> None:
        """Take in a packet; one that arrived long before the newest says nothing any more."""
        if self._newest_ns is None or abs(arrived_ns - self._newest_ns) > CLOCK_JUMP_NS:
            self._first_ns = self._newest_ns = arrived_ns
            self._recent.clear()
            self._windows.clear()
        elif arrived_ns < self._newest_ns - _LEVEL_NS:
            return
        self._newest_ns = max(arrived_ns, self._newest_ns)
        delay_ns = arrived_ns - sent_ns
        while self._recent and self._recent[-1][1] >= delay_ns:
            self._recent.pop()
        self._recent.append((arrived_ns, delay_ns))
        while self._recent[0][0] < self._newest_ns - _LEVEL_NS:
            self._recent.popleft()
        window = (arrived_ns - self._first_ns) // _LEVEL_NS
        if not self._windows or window > self._windows[-1][0]:
            self._windows.append((window, delay_ns))
            while self._windows[0][0] < window - _BASE_NS // _LEVEL_NS:
                self._windows.popleft()
        elif window == self._windows[-1][0]:
            self._windows[-1] = window, min(delay_ns, self._windows[-1][1])

    def queue_ns(self) -> float:
        """Time that packets wait at the bottleneck beyond jitter [ns]; 0 before the first one."""
        if not self._recent:
            return 0.0
        base_ns = min(delay_ns for _, delay_ns in self._windows)
        return max(0.0, self._recent[0][1] - base_ns - self._noise_ns())

    def _noise_ns(self) -> float:
        steps = [abs(b - a) for (_, a), (_, b) in pairwise(self._windows)]
        return min(_NOISE_STEPS * median(steps), _NOISE_MAX_NS) if len(steps) > 2 else 0.0

    def forget(self) -> None:
        """Take the level of now for the base: the route has become longer, or others fill it."""
        if self._recent:
            window = self._windows[-1][0]
            self._windows.clear()
            self._windows.append((window, self._recent[0][1]))
