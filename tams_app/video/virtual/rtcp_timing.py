"""Timing of an RTCP session: regular reports, and early ones that cannot wait.

The rules are those of RFC 3550 (6.3) and RFC 4585 (3.5), as GStreamer's rtpsession applies them
between two ends (no dithering): `bandwidth` sets an interval of a few milliseconds, the regular
reports keep `t_rr_interval` apart, and one early report may follow each regular one at once; the
next early one waits for the interval to pass.
"""

from __future__ import annotations

from enum import Enum
from random import Random

from tams_app.units import NS_PER_S

_RTCP_SHARE = 0.05  # of the session's bandwidth
_COMPENSATION = 2.71828 - 1.5  # RFC 3550, 6.3.1: reconsideration converges to less than intended
_FIRST_AVERAGE_BYTES = 100


class RtcpReport(Enum):
    """The kind of report: an early one carries no reception statistics."""

    REGULAR = "regular"
    EARLY = "early"


class RtcpTiming:
    """The timer of one session; silent until `start`.

    `t_rr_interval_ns`: mean time between regular reports (T_rr_interval). `bandwidth_bps`: of the
    whole session, of which RTCP gets a twentieth.
    """

    def __init__(self, random: Random, t_rr_interval_ns: int, bandwidth_bps: float) -> None:
        self.members = 2  # the two ends; every further stream is one more
        self._random = random
        self._t_rr_interval_ns = t_rr_interval_ns
        self._rtcp_bps = _RTCP_SHARE * bandwidth_bps
        self._average_bytes = _FIRST_AVERAGE_BYTES
        self._next_regular_ns: int | None = None
        self._next_early_ns: int | None = None
        self._interval_ns = 0
        self._last_ns: int | None = None  # any report
        self._last_regular_ns: int | None = None

    @property
    def next_ns(self) -> int | None:
        """The time at which `step` must be called [ns]; None while the session is silent."""
        return self._next_regular_ns if self._next_early_ns is None else self._next_early_ns

    def start(self, now_ns: int) -> None:
        """The first packet came or went; later calls change nothing."""
        if self._next_regular_ns is None:
            self._interval_ns = self._jittered_interval_ns()
            self._next_regular_ns = now_ns + self._interval_ns

    def observe(self, size_bytes: int) -> None:
        """A report of `size_bytes` (IP datagram) was sent or received."""
        self._average_bytes = (size_bytes + 15 * self._average_bytes) >> 4

    def request(self, now_ns: int, time_left_ns: int) -> None:
        """Something wants to leave before `now_ns + time_left_ns`: an early report, if allowed.

        If none is allowed, what wants to leave goes with the next regular report.
        """
        if self._next_early_ns is not None or self._next_regular_ns is None:
            return
        if self._last_ns is None or now_ns > self._next_regular_ns:
            return
        if self._last_ns == self._last_regular_ns:
            self._next_early_ns = now_ns
        elif self._last_ns + self._interval_ns <= now_ns + time_left_ns:
            self._next_early_ns = max(now_ns, self._last_ns + self._interval_ns)

    def step(self, now_ns: int) -> RtcpReport | None:
        """The timer has run out: which report leaves now, None if it was reconsidered."""
        report: RtcpReport | None
        if self._next_early_ns is not None:
            self._next_early_ns = None
            self._last_ns = now_ns
            report = RtcpReport.EARLY
        else:
            report = self._regular(now_ns)
        if self._next_regular_ns is not None and self._next_regular_ns < now_ns:
            self._interval_ns = self._jittered_interval_ns()
            self._next_regular_ns = now_ns + max(self._interval_ns, self._spread_ns())
        return report

    def _regular(self, now_ns: int) -> RtcpReport | None:
        interval_ns = self._jittered_interval_ns()
        is_first = self._last_ns is None
        if self._last_ns is not None and now_ns < self._last_ns + interval_ns:
            self._interval_ns = interval_ns
            self._next_regular_ns = self._last_ns + interval_ns
            return None
        self._interval_ns = interval_ns
        wait_ns = interval_ns if is_first else max(interval_ns, self._spread_ns())
        self._next_regular_ns = now_ns + wait_ns
        self._last_ns = self._last_regular_ns = now_ns
        return RtcpReport.REGULAR

    def _jittered_interval_ns(self) -> int:
        seconds = 8 * self._average_bytes * self.members / self._rtcp_bps
        return int(seconds * NS_PER_S * self._random.uniform(0.5, 1.5) / _COMPENSATION)

    def _spread_ns(self) -> int:
        return int(self._random.uniform(0.5, 1.5) * self._t_rr_interval_ns)
