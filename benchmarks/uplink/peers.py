"""Rules that others use, over the same feedback: lines to compare `feedback` with in the model.

They are no budgets of the product, and none of them pads.
"""

from __future__ import annotations

import importlib.util
import math
from abc import ABC, abstractmethod
from collections import deque
from collections.abc import Callable
from typing import Any

from tams_app.config import PolicyConfig
from tams_app.policy.budget import Budget
from tams_app.records import UplinkReport
from tams_app.units import NS_PER_MS, NS_PER_S

_FIRST_KBPS, _LEAST_KBPS = 500.0, 60.0  # about the floors, where `feedback` begins, too
_BASE_NS = 10 * NS_PER_S  # the least round trip of so long is the base
_RATE_NS = NS_PER_S // 4


class _Peer(ABC):
    """A rate [kbit/s], and bytes that may be under way, which `_hear` changes by each report.

    A report waits for up to 50 ms: a round trip is the least of a quarter of a second.
    """

    def __init__(self, policy: PolicyConfig) -> None:
        self._most_kbps = policy.budget.max_kbps
        self._kbps = _FIRST_KBPS
        self._window_bytes = math.inf
        self._trips_ns: deque[tuple[int, int]] = deque()  # (heard, round trip)

    def observe(self, report: UplinkReport) -> None:
        if not report.arrivals:
            return
        trip_ns = report.now_ns - max(arrival.sent_ns for arrival in report.arrivals)
        self._trips_ns.append((report.now_ns, trip_ns))
        while self._trips_ns[0][0] < report.now_ns - _BASE_NS:
            self._trips_ns.popleft()
        self._hear(report)

    def _least_trip_ns(self, span_ns: int) -> int:
        newest_ns = self._trips_ns[-1][0]
        return min(trip for heard, trip in self._trips_ns if heard >= newest_ns - span_ns)

    @abstractmethod
    def _hear(self, report: UplinkReport) -> None: ...

    def capacity_kbps(self, _now_ns: int) -> float:
        return min(max(self._kbps, _LEAST_KBPS), self._most_kbps)

    def padding_bytes(self, _now_ns: int) -> int:
        return 0

    def flight_limit_bytes(self, _now_ns: int) -> float:
        return self._window_bytes


class ConstantWindow(_Peer):
    """60 kB under way, whatever the link is; its rate is the window in each round trip."""

    _BYTES = 60_000.0

    def _hear(self, report: UplinkReport) -> None:
        self._window_bytes = self._BYTES
        self._kbps = self._BYTES * 8e6 / self._least_trip_ns(_RATE_NS)


class DelayRule(_Peer):
    """Under way is 1.05 times what is delivered in the base round trip and 20 ms."""

    def __init__(self, policy: PolicyConfig) -> None:
        super().__init__(policy)
        self._arrived: deque[tuple[int, int]] = deque()  # (when, bytes)

    def _hear(self, report: UplinkReport) -> None:
        for one in report.arrivals:
            if one.arrived_ns is not None:
                self._arrived.append((one.arrived_ns, one.size_bytes))
        while self._arrived and self._arrived[0][0] < self._arrived[-1][0] - _RATE_NS:
            self._arrived.popleft()
        bytes_per_ns = sum(size for _, size in self._arrived) / _RATE_NS
        base_ns = self._least_trip_ns(_BASE_NS)
        self._window_bytes = max(6000.0, 1.05 * bytes_per_ns * (base_ns + 20 * NS_PER_MS))
        self._kbps = self._window_bytes * 8e6 / self._least_trip_ns(_RATE_NS)
        self._window_bytes *= 1.0 + _RATE_NS / base_ns  # frames come in bursts, and reports rarely


class Aiortc(_Peer):
    """The rate control of aiortc itself (`pip install aiortc`), as its receiver would ask for."""

    _SSRC = 1

    def __init__(self, policy: PolicyConfig) -> None:
        super().__init__(policy)
        rate: Any = importlib.import_module("aiortc.rate")
        self._estimator = rate.RemoteBitrateEstimator()

    def _hear(self, report: UplinkReport) -> None:
        for one in report.arrivals:
            if one.arrived_ns is None:
                continue
            sent = (one.sent_ns * (1 << 18) // NS_PER_S) % (1 << 24)  # abs-send-time: 6.18 seconds
            arrived_ms = one.arrived_ns // NS_PER_MS
            asked = self._estimator.add(arrived_ms, sent, one.size_bytes, self._SSRC)
            if asked is not None:
                self._kbps = asked[0] / 1000.0


PEERS: dict[str, Callable[[PolicyConfig], Budget]] = {
    "constant window": ConstantWindow,
    "delay rule": DelayRule,
}
if importlib.util.find_spec("aiortc") is not None:
    PEERS["aiortc"] = Aiortc
