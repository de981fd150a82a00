"""The budget that knows the emulated link: the reference for experiments."""

from __future__ import annotations

import math

from tams_app.capacity import Capacity
from tams_app.config import BudgetConfig
from tams_app.records import UplinkReport
from tams_app.units import NS_PER_MS

_WINDOW_NS = 100 * NS_PER_MS  # of a trace: two steps of the policy loop


class OracleBudget:
    """The link's own rate; of a trace the mean of its last window, without look-ahead."""

    def __init__(self, capacity: Capacity, config: BudgetConfig) -> None:
        self._capacity = capacity
        self._max_kbps = config.max_kbps

    def observe(self, report: UplinkReport) -> None:
        """Ignored: the rate is known."""

    def capacity_kbps(self, now_ns: int) -> float:
        return min(self._max_kbps, self._capacity.mean_kbps(now_ns - _WINDOW_NS, now_ns))

    def padding_bytes(self, now_ns: int) -> int:
        return 0

    def flight_limit_bytes(self, now_ns: int) -> float:
        return math.inf
