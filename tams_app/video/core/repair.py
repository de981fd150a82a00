"""Repair of lost packets on a given network: RTX, parity, the jitter buffer's latency, PLI.

And which frames are whole: as they were encoded, every packet of their chain here.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from tams_app.config import Network, RepairConfig
from tams_app.units import NS_PER_MS, NS_PER_S

_RTX_WORTH_MS = 200.0  # mode paper: beyond this a resent packet comes too late for the operator
MARGIN_MS = 20.0  # loss detection, feedback timing, scheduling
_LENGTH_BYTES = 4  # before each NAL unit, as the depayloader puts them together (`avc`)
_TYPE, _IDR = 0x1F, 5


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


class KeyframeRequests:
    """Rate limit of keyframe requests (PLI): one per interval; an early one waits for its turn.

    A whole chain (`WholeChain`) answers every request before it. A PLI that stays unanswered for
    two intervals was lost itself and is sent again.
    """

    def __init__(self, interval_ms: float) -> None:
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
        wait_ns = self._interval_ns if self._waiting else 2 * self._interval_ns
        if self._last_ns is not None and now_ns - self._last_ns < wait_ns:
            return False
        self._waiting = False
        self._last_ns = now_ns
        return True

    def chain(self, unbroken: bool) -> None:
        """An access unit came: whether it is whole; where it is not, a keyframe is needed."""
        self._unanswered = not unbroken
        self._waiting = self._waiting and not unbroken


class WholeChain:
    """Judges the access units of one view, in the order of decoding: whether a frame is whole.

    A frame is predicted from the frames before it, back to the last keyframe: its chain. A packet
    that is missing damages its frame and all that follow, up to a keyframe of which all packets
    are here. Decoders do not report it (FINDINGS 4), so it is inferred from the gaps in the
    sequence numbers that the depayloader meets: of what was resent or restored in time it meets
    none. 3 s without a frame are a gap, too: the numbers may have wrapped meanwhile. `concealment`
    infers the same afterwards, from the fates of all packets; there a frame is concealed that is
    not whole here.
    """

    def __init__(self) -> None:
        self.unbroken = False  # nothing can be predicted before the first keyframe
        self._gap_timestamp: int | None = None
        self._after_gap = False

    def gap(self, timestamp: int) -> None:
        """Packets are missing before the first one to come of the frame with this RTP timestamp.

        Which frame they were of is not known: it may be this one.
        """
        self.unbroken = False
        self._gap_timestamp, self._after_gap = timestamp, True

    def access_unit(self, timestamp: int, has_idr: bool, has_end: bool) -> bool:
        """Take in the end of a frame; True if it is whole.

        `has_end`: its last packet is here, as RTP's marker bit shows. The depayloader may hand out
        the remains of a frame before what follows the gap, or remains within what follows it.
        """
        is_complete = has_end and not self._after_gap and timestamp != self._gap_timestamp
        self._after_gap = False
        self.unbroken = is_complete and (has_idr or self.unbroken)
        return self.unbroken


def has_idr(access_unit: bytes) -> bool:
    """True if a slice of an IDR picture (H.264) is in it: no later frame needs one before it.

    Parameter sets alone make no keyframe, though GStreamer flags them as one.
    """
    at = 0
    while at + _LENGTH_BYTES < len(access_unit):
        if access_unit[at + _LENGTH_BYTES] & _TYPE == _IDR:
            return True
        at += _LENGTH_BYTES + int.from_bytes(access_unit[at : at + _LENGTH_BYTES])
    return False
