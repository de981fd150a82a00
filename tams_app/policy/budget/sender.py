"""The budget from RTP sender statistics and RTCP receiver reports."""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence

from tams_app.capacity import Capacity
from tams_app.config import PolicyConfig
from tams_app.policy.budget import Budget
from tams_app.records import Reception, UplinkReport
from tams_app.units import NS_PER_MS, NS_PER_S

START_KBPS = 3000.0  # capacity before the first report: what a poor uplink carries
WINDOW_MS = 1000  # reports of this long are judged together: one of each view, or more
_INCREASE_KBPS_S = 100.0
_DECREASE = 0.85
_HOLD_LOSS = 0.02  # a radio loses less without congestion
_CUT_LOSS = 0.1
_USED = 0.9  # share of what was allowed from which a window shows that it can be carried
_SILENCE = 5  # windows without a report before it counts as congestion
_TRIPS = 10  # windows that are remembered for the smallest round trip


class SenderBudget(Budget):
    """Additive increase and multiplicative decrease by what the receivers report, window by window.

    The paper (section III-D) takes the capacity from the sender's statistics in a sliding window.
    Those cannot show free capacity: what is sent is the smaller of what was allowed and what the
    encoders made, and any function of it integrates the encoders' bias. So they only say here
    whether the allowance was used, and receiver reports whether it was carried: loss, or a round
    trip that is longer than the smallest of the last windows by the delay target and the jitter.

    Limits: it starts at `START_KBPS`, right or wrong, and stays there as long as no report comes;
    it finds free capacity at 100 kbit/s a second; it sees congestion a reporting interval late, in
    a round trip that includes the way back and in losses when the queue has overflowed; between
    2 and 10 % it cannot distinguish a bad radio from a full queue, and holds.
    """

    def __init__(self, policy: PolicyConfig, capacity: Capacity) -> None:
        super().__init__(policy, capacity)
        self._config = config = policy.budget
        self._window_ns = WINDOW_MS * NS_PER_MS
        self._kbps = min(START_KBPS, config.max_kbps)
        self._began: tuple[int, int] | None = None  # the window: its time, bytes sent until then
        self._reports: list[Reception] = []
        self._trips_ns: deque[int] = deque(maxlen=_TRIPS)  # the smallest of each window
        self._silent_windows: int | None = None  # None before the first report

    def observe(self, report: UplinkReport) -> None:
        self._reports += report.receptions
        if self._began is None:
            self._began = report.now_ns, report.sent_bytes
        began_ns, began_bytes = self._began
        elapsed_ns = report.now_ns - began_ns
        if elapsed_ns < self._window_ns:
            return
        sent_kbps = (report.sent_bytes - began_bytes) * 8e6 / elapsed_ns
        self._judge(self._reports, sent_kbps, elapsed_ns / NS_PER_S)
        self._began, self._reports = (report.now_ns, report.sent_bytes), []

    def _judge(self, reports: Sequence[Reception], sent_kbps: float, elapsed_s: float) -> None:
        if not reports:
            if self._silent_windows is None:
                return
            self._silent_windows += 1
            if self._silent_windows > _SILENCE:
                self._kbps *= _DECREASE
            return
        self._silent_windows = 0
        lost = sum(report.fraction_lost for report in reports) / len(reports)
        if lost > _CUT_LOSS or self._delayed(reports):
            self._kbps *= _DECREASE
        elif lost <= _HOLD_LOSS and sent_kbps >= _USED * self._kbps * self._config.safety_factor:
            self._kbps = min(self._config.max_kbps, self._kbps + _INCREASE_KBPS_S * elapsed_s)

    def _delayed(self, reports: Sequence[Reception]) -> bool:
        trips_ns = [trip for r in reports if (trip := r.round_trip_ns) is not None]
        if not trips_ns:
            return False
        self._trips_ns.append(min(trips_ns))
        jitter_ns = max(report.jitter_ns for report in reports)
        target_ns = self._config.delay_target_ms * NS_PER_MS
        return min(trips_ns) - min(self._trips_ns) > target_ns + 2 * jitter_ns

    def capacity_kbps(self, now_ns: int) -> float:
        return self._kbps
