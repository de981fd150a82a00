"""How lost packets are repaired on a given network: RTX, the jitter buffer's patience, PLI."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tams_app.config import Network, RepairConfig
from tams_app.runtime.clock import NS_PER_MS

_RTX_WORTH_MS = 200.0  # beyond this a resent packet comes too late for the operator
_MARGIN_MS = 20.0  # loss detection, feedback timing, scheduling


@dataclass(frozen=True, slots=True)
class RepairRule:
    """The same for all views and strategies on one network (docs/ARCHITECTURE.md)."""

    rtx: bool
    latency_ms: int  # of the jitter buffer; spent only while waiting for a gap
    pli_interval_ms: float  # at most one PLI per view in this time
    pli: bool = True


_AS_THE_RULE_SAYS = RepairConfig()


def repair_rule(
    network: Network, pli_min_interval_ms: float, wanted: RepairConfig = _AS_THE_RULE_SAYS
) -> RepairRule:
    """RTX while a resend fits into 200 ms: 1.2·RTT + 2·jitter + 20 ms; else 2·jitter + 20 ms.

    `wanted` may have RTX on or off whatever a resend takes, and do without PLI.
    """
    round_trip_ms = 2.0 * network.latency_ms
    without_rtx_ms = 2.0 * network.jitter_ms + _MARGIN_MS
    with_rtx_ms = 1.2 * round_trip_ms + without_rtx_ms
    rtx = with_rtx_ms <= _RTX_WORTH_MS if wanted.rtx == "auto" else wanted.rtx == "on"
    return RepairRule(
        rtx=rtx,
        latency_ms=math.ceil(with_rtx_ms if rtx else without_rtx_ms),
        pli_interval_ms=max(round_trip_ms, pli_min_interval_ms),
        pli=wanted.pli,
    )


class KeyframeRequests:
    """Rations frame loss indications: one per interval; an early request waits, none is lost.

    An undamaged keyframe answers every request before it: it repairs the frame. A PLI that
    stays unanswered for two intervals was lost itself and is sent again.
    """

    def __init__(self, interval_ms: float) -> None:
        self.sent = 0
        self._interval_ns = round(interval_ms * NS_PER_MS)
        self._last_ns: int | None = None
        self._unanswered = False
        self._waiting = False  # a loss later than the last PLI

    def request(self, now_ns: int) -> bool:
        """A loss was seen: True if the PLI may leave now, else it waits for `due`."""
        self._unanswered = self._waiting = True
        return self.due(now_ns)

    def due(self, now_ns: int) -> bool:
        """True, once, when a waiting or unanswered PLI must leave now."""
        if not self._unanswered:
            return False
        patience_ns = self._interval_ns if self._waiting else 2 * self._interval_ns
        if self._last_ns is not None and now_ns - self._last_ns < patience_ns:
            return False
        self._waiting = False
        self._last_ns = now_ns
        self.sent += 1
        return True

    def keyframe(self, damaged: bool) -> None:
        """A keyframe left the depayloader, `damaged` if packets before or in it were lost."""
        if not damaged:
            self._unanswered = self._waiting = False
