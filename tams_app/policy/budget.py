"""Estimates of the uplink's capacity, before the safety factor."""

from __future__ import annotations

from collections import deque
from typing import Protocol

from tams_app.capacity import Capacity
from tams_app.config import BudgetConfig
from tams_app.records import UplinkReport
from tams_app.units import NS_PER_MS, NS_PER_S


class Budget(Protocol):
    """A source of capacity estimates; `observe` is called before each `capacity_kbps`."""

    def observe(self, report: UplinkReport) -> None:
        """Take in what the senders know; the time of `report` never decreases."""

    def capacity_kbps(self, now_ns: int) -> float:
        """The capacity that the uplink is believed to have at `now_ns`.

        Args:
            now_ns: the time [ns] of the last `observe`.

        Returns:
            The estimate [kbit/s of IP datagram bytes], finite and not negative. The policy
            multiplies it with the safety factor (0.92 in the paper, section IV-C).
        """


class OracleBudget:
    """The link's own rate; of a trace the mean of its last window, without look-ahead."""

    def __init__(self, capacity: Capacity, config: BudgetConfig) -> None:
        self._capacity = capacity
        self._max_kbps = config.max_kbps
        self._window_ns = round(config.trace_window_ms * NS_PER_MS)

    def observe(self, report: UplinkReport) -> None:
        """Ignored: the rate is known."""

    def capacity_kbps(self, now_ns: int) -> float:
        return min(self._max_kbps, self._capacity.mean_kbps(now_ns - self._window_ns, now_ns))


class SenderBudget:
    """The rate that was sent over a sliding window (paper, section III-D).

    Outgoing statistics cannot see free capacity: what is sent is the smaller of what was allowed
    and what the encoders made. Taken as the capacity and multiplied with the safety factor it
    would ratchet down to the floor, so the estimate is the sent rate divided by that factor: the
    budget stays near where it started, grows only by the encoders' overshoot and does not notice
    congestion.
    """

    def __init__(self, config: BudgetConfig) -> None:
        self._config = config
        self._window_ns = round(config.window_ms * NS_PER_MS)
        self._sent: deque[tuple[int, int]] = deque()  # (time, bytes sent since the start)

    def observe(self, report: UplinkReport) -> None:
        now_ns = report.now_ns
        self._sent.append((now_ns, report.sent_bytes))
        while len(self._sent) > 2 and self._sent[1][0] <= now_ns - self._window_ns:
            self._sent.popleft()

    def capacity_kbps(self, now_ns: int) -> float:
        config = self._config
        if not self._sent or self._sent[-1][0] - self._sent[0][0] < self._window_ns:
            return config.start_kbps
        (start_ns, start_bytes), (end_ns, end_bytes) = self._sent[0], self._sent[-1]
        sent_kbps = (end_bytes - start_bytes) * 8 / 1000 / ((end_ns - start_ns) / NS_PER_S)
        return min(config.max_kbps, sent_kbps / config.safety_factor)


def make_budget(config: BudgetConfig, capacity: Capacity) -> Budget:
    """The budget of `config.mode`; `capacity` is what the oracle knows."""
    return SenderBudget(config) if config.mode == "sender" else OracleBudget(capacity, config)
