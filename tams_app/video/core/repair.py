"""Repair of lost packets on a given network: RTX, parity, the jitter buffer's latency, PLI."""

from __future__ import annotations

import math
from dataclasses import dataclass

from tams_app.config import Network, RepairConfig
from tams_app.units import NS_PER_MS, NS_PER_S

_RTX_WORTH_MS = 200.0  # mode paper: beyond this a resent packet comes too late for the operator
MARGIN_MS = 20.0  # loss detection, feedback timing, scheduling


@dataclass(frozen=True, slots=True)
class RepairRule:
    """The repair of lost packets; the same for all strategies on one network.

    Attributes:
        rtx: whether lost packets are asked for (NACK) and sent again (RTX, RFC 4588).
        latency_ms: latency of the jitter buffer at 30 frames a second (`wait_ms` has it at any
            rate); spent only while it waits for a gap to fill.
        pli_interval_ms: at most one keyframe request (PLI, RFC 4585) per view in this time.
        pli: whether keyframes are requested at all.
        parity: whether views may be protected by parity packets (`protection` says which).
        longest_wait_ms: the jitter buffer's latency at any rate is at most this.
    """

    rtx: bool
    latency_ms: int
    pli_interval_ms: float
    pli: bool = True
    parity: bool = False
    longest_wait_ms: float = math.inf

    def wait_ms(self, usual_ns: int) -> int:
        """Latency of the jitter buffer where frames are usually `usual_ns` apart.

        The rarer the frames, the larger: a resend waits at the bottleneck behind those of the
        other views, for as long as the time between frames at most.
        """
        if not self.rtx:
            return self.latency_ms
        rarer_ms = max(0, usual_ns - NS_PER_S // 30) // NS_PER_MS
        return math.floor(min(self.latency_ms + rarer_ms, self.longest_wait_ms))


_BY_THE_RULE = RepairConfig(mode="paper")


def repair_rule(
    network: Network,
    pli_min_interval_ms: float,
    wanted: RepairConfig = _BY_THE_RULE,
    latency_bound_ms: float = 200.0,
    real: bool = False,
) -> RepairRule:
    """The rule for one network: its one-way latency and jitter are used.

    A resend takes up to 1.2·RTT + 2·jitter + 20 ms, at best RTT + 20 ms. In mode `paper` there is
    RTX where the former is at most 200 ms, and the jitter buffer waits that long; elsewhere there
    is none and it waits 2·jitter + 20 ms. In mode `adaptive` no frame is to wait until later than
    `latency_bound_ms` after it was sent: there is RTX where the best resend comes by then, and
    parity where not all do.

    Args:
        network: the conditions.
        pli_min_interval_ms: PLIs of a view are at least this apart, and a round trip; in mode
            `adaptive` two, with what jitter and queue add.
        wanted: `video.repair`: the mode; RTX and parity forced on or off; without PLI.
        latency_bound_ms: of mode `adaptive`.
        real: the network is not (only) emulated, so it may be longer than `network` says: in mode
            `adaptive` parity is possible, and `Protection` measures whether it is needed.
    """
    round_trip_ms = 2.0 * network.latency_ms
    without_rtx_ms = 2.0 * network.jitter_ms + MARGIN_MS
    resend_ms = 1.2 * round_trip_ms + without_rtx_ms
    pli_interval_ms = max(round_trip_ms, pli_min_interval_ms)
    if wanted.mode == "paper":
        rtx = _choose(wanted.rtx, resend_ms <= _RTX_WORTH_MS)
        latency_ms = math.ceil(resend_ms if rtx else without_rtx_ms)
        return RepairRule(rtx, latency_ms, pli_interval_ms, wanted.pli)
    # The sender's rtpsession ignores a request less than two round trips, as it measures them with
    # queue and jitter, after the last: one sent again too soon would be missed for two intervals.
    pli_interval_ms = max(2.0 * (round_trip_ms + without_rtx_ms), pli_min_interval_ms)
    spare_ms = latency_bound_ms - network.latency_ms - network.jitter_ms
    longest_ms = max(spare_ms, without_rtx_ms)
    rtx = _choose(wanted.rtx, round_trip_ms + MARGIN_MS <= spare_ms)
    parity = _choose(wanted.parity, real or resend_ms > spare_ms)
    latency_ms = math.ceil(min(resend_ms, longest_ms) if rtx else without_rtx_ms)
    return RepairRule(rtx, latency_ms, pli_interval_ms, wanted.pli, parity, math.ceil(longest_ms))


def _choose(wanted: str, by_rule: bool) -> bool:
    return by_rule if wanted == "auto" else wanted == "on"
