"""The two RTCP sessions of one view, without packets: what they count and ask, when it leaves.

Calibrated against GStreamer's rtpsession (`benchmarks.experiments.feedback_model` at 628dd78b).
The rules of timing, of regular reports and of early ones that cannot wait, are those of RFC 3550
(6.3) and RFC 4585 (3.5), as rtpsession applies them between two ends (no dithering): `bandwidth`
sets an interval of a few milliseconds, the regular reports keep `t_rr_interval` apart, and one
early report may follow each regular one at once; the next early one waits for the interval to pass.
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from itertools import pairwise
from random import Random

from tams_app.records import PacketKind
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.frame_identity import RTP_CLOCK_HZ
from tams_app.video.core.packets import SEQUENCES, RtpHeader, transport_sequence
from tams_app.video.core.pipelines import (
    RECEIVER_REPORTS_NS,
    SENDER_REPORTS_NS,
    SESSION_BANDWIDTH_BPS,
)
from tams_app.video.core.rtcp import ARRIVAL_TICK_NS, ReportBlock

_RTCP_SHARE = 0.05  # of the session's bandwidth
_COMPENSATION = 2.71828 - 1.5  # RFC 3550, 6.3.1: reconsideration converges to less than intended
_FIRST_AVERAGE_BYTES = 100
# Sizes [bytes] of IP datagrams as rtpsession fills them: UDP and IP, a report, SDES with a name
# of 28 characters (all of it, or in an early report the name alone), then what is asked.
_HEADERS = 28
_RECEIVER_REPORT, _REPORT_BLOCK, _SENDER_REPORT = 8, 24, 28
_SDES, _SHORT_SDES = 52, 40
_NACK, _NACK_ENTRY, _PLI = 12, 4, 12
_OF_OUR_OWN = {PacketKind.PARITY, PacketKind.PADDING}  # streams that begin when they are needed
_NACK_REACH = 16  # an entry asks for a packet and any of the 16 that follow
_FEEDBACK, _MESSAGE, _CHUNK = 12, 8, 2
_SHORT_WAIT_TICKS, _SHORT_VECTOR, _LONG_VECTOR = 255, 7, 14
# Without the end of a frame, that many lost packets after so many that came make a message, too.
_LOST_WITHOUT_END, _CAME_WITHOUT_END = 60, 10

_KEYFRAME_TIMEOUT_NS = 5 * NS_PER_S
_ARRIVALS_TIMEOUT_NS = 100 * NS_PER_MS
_LONGEST_ROUND_TRIP_NS = 5 * NS_PER_S
_ROUND_TRIP_UNIT_NS = NS_PER_S / 65536


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


@dataclass(frozen=True, slots=True)
class ArrivalMessage:
    """A datagram that reports the packets up to `last`, by transport-wide sequence number."""

    last: int
    arrived_ns: dict[int, int]  # of those that arrived
    size_bytes: int  # IP datagram


@dataclass(frozen=True, slots=True)
class Feedback:
    """One RTCP datagram of a receiver: what it asks for, and which sender report it answers.

    `arrivals` leave with it, each a datagram of its own.
    """

    sent_ns: int
    nacks: tuple[int, ...]  # sequence numbers of the media packets to send again
    pli: bool
    size_bytes: int
    # how long the last sender report was on its way; None: no report block, or none came yet
    report_transit_ns: int | None
    arrivals: tuple[ArrivalMessage, ...] = ()
    block: ReportBlock | None = None  # None: in an early report


class ArrivalMessages:
    """Makes one message for each frame, when its last packet comes."""

    def __init__(self) -> None:
        self._arrived: dict[int, int] = {}
        self._messages: list[ArrivalMessage] = []

    def received(self, now_ns: int, sequence: int, ends_frame: bool) -> bool:
        """A packet came, in the order of sending; whether a message is to leave."""
        self._arrived[sequence] = now_ns - now_ns % ARRIVAL_TICK_NS
        came = len(self._arrived)
        count = (sequence - next(iter(self._arrived))) % SEQUENCES + 1
        many_lost = count - came >= _LOST_WITHOUT_END and came >= _CAME_WITHOUT_END
        if not ends_frame and not many_lost:
            return False
        size_bytes = _message_bytes(list(self._arrived.values()), count)
        self._messages.append(ArrivalMessage(sequence, self._arrived, size_bytes))
        self._arrived = {}
        return True

    def take(self) -> tuple[ArrivalMessage, ...]:
        """The messages made since the last call."""
        messages, self._messages = tuple(self._messages), []
        return messages


class StreamStatistics:
    """The media stream's statistics for report blocks (RFC 3550, A.3 and A.8)."""

    def __init__(self) -> None:
        self._highest = -1
        self._received = 0
        self._transit: int | None = None
        self._jitter = 0  # 16 times

    def received(self, now_ns: int, header: RtpHeader) -> None:
        ahead = (header.sequence - self._highest) % SEQUENCES
        if ahead < SEQUENCES // 2:
            self._highest += ahead
        self._received += 1
        transit = now_ns * RTP_CLOCK_HZ // NS_PER_S - header.timestamp
        if self._transit is not None:
            self._jitter += abs(transit - self._transit) - (self._jitter + 8 >> 4)
        self._transit = transit

    def block(self, ssrc: int) -> ReportBlock:
        """The block of a report that leaves now; the round trip is for the sender to know."""
        lost = self._highest + 1 - self._received
        return ReportBlock(ssrc, lost, self._highest, self._jitter >> 4, None)


class ReceiverSession:
    """Counts what comes, and collects what is asked for until RTCP may leave."""

    def __init__(
        self, random: Random, rtx: bool, media_ssrc: int = 0, feedback: bool = False
    ) -> None:
        """`feedback`: it reports when each packet came."""
        self.timing = RtcpTiming(random, RECEIVER_REPORTS_NS, SESSION_BANDWIDTH_BPS)
        self._nacks: dict[int, int] = {}  # sequence number -> when asking becomes pointless
        self._rtx = rtx
        self._pli = False
        self._kinds: set[PacketKind] = set()  # that have come
        self._report_transit_ns: int | None = None
        self._media_ssrc = media_ssrc
        self._statistics = StreamStatistics()
        self._arrivals = ArrivalMessages() if feedback else None

    def received(
        self, now_ns: int, kind: PacketKind, packet: bytes = b"", header: RtpHeader | None = None
    ) -> None:
        """A packet came; its header, None if it is no RTP."""
        self.timing.start(now_ns)
        self._kinds.add(kind)
        if header is None:
            return
        if kind is PacketKind.MEDIA:
            self._statistics.received(now_ns, header)
        if self._arrivals is not None:
            sequence = transport_sequence(packet)
            if self._arrivals.received(now_ns, sequence, header.marker):
                self.timing.request(now_ns, _ARRIVALS_TIMEOUT_NS)

    def received_report(self, transit_ns: int, size_bytes: int) -> None:
        self._report_transit_ns = transit_ns
        self.timing.members = 2 + self._rtx + len(self._kinds & _OF_OUR_OWN)
        self.timing.observe(size_bytes)

    def ask_again(self, now_ns: int, sequence: int, time_left_ms: int) -> None:
        """The jitter buffer misses a packet that must be asked for within `time_left_ms`."""
        time_left_ns = time_left_ms * NS_PER_MS
        self._nacks[sequence] = now_ns + time_left_ns
        self.timing.request(now_ns, time_left_ns)

    def ask_keyframe(self, now_ns: int) -> None:
        """The depayloader cannot go on without a keyframe."""
        self._pli = True
        self.timing.request(now_ns, _KEYFRAME_TIMEOUT_NS)

    def step(self, now_ns: int) -> Feedback | None:
        """The datagram that leaves now, None if the timer was reconsidered."""
        report = self.timing.step(now_ns)
        if report is None:
            return None
        regular = report is RtcpReport.REGULAR
        nacks, pli = self._take_nacks(now_ns, regular), self._pli
        self._pli = False
        size_bytes = _HEADERS + _RECEIVER_REPORT + (_SDES if regular else _SHORT_SDES)
        size_bytes += _PLI * pli + _nack_bytes(nacks)
        if regular:
            size_bytes += _REPORT_BLOCK * len(self._kinds | {PacketKind.MEDIA})
        self.timing.observe(size_bytes)
        transit_ns = self._report_transit_ns if regular else None
        arrivals = () if self._arrivals is None else self._arrivals.take()
        for message in arrivals:
            self.timing.observe(message.size_bytes)
        reported = self._statistics.block(self._media_ssrc) if regular else None
        return Feedback(now_ns, nacks, pli, size_bytes, transit_ns, arrivals, reported)

    def _take_nacks(self, now_ns: int, regular: bool) -> tuple[int, ...]:
        """The pending numbers in order, without the expired; an early report keeps the last."""
        pending = sorted(self._nacks, key=lambda sequence: (self._nacks[sequence], sequence))
        expired = 0
        for sequence in pending:
            if self._nacks[sequence] >= now_ns:
                break
            expired += 1
        if pending and not regular:
            expired = min(expired, len(pending) - 1)
        self._nacks.clear()
        return tuple(pending[expired:])


class SenderSession:
    """The sender's reports, and its refusal of keyframe requests that come too soon."""

    def __init__(self, random: Random, rtx: bool) -> None:
        self.timing = RtcpTiming(random, SENDER_REPORTS_NS, SESSION_BANDWIDTH_BPS)
        self.timing.members = 2 + rtx
        self._rtx = rtx
        self.round_trip_ns = 0  # 0: not known yet
        self._last_keyframe_ns: int | None = None
        self._kinds: set[PacketKind] = set()  # that have left

    def sent(self, now_ns: int, kind: PacketKind) -> None:
        self.timing.start(now_ns)
        self._kinds.add(kind)
        self.timing.members = 2 + self._rtx + len(self._kinds & _OF_OUR_OWN)

    def step(self, now_ns: int) -> list[int]:
        """Sizes [bytes] of the reports that leave now: the media stream's, RTX's, our own streams'.

        A stream that has sent nothing yet gives the report of a receiver.
        """
        if self.timing.step(now_ns) is None:
            return []
        sizes = [_HEADERS + _SENDER_REPORT + _SDES]
        if self._rtx:
            repaired = PacketKind.REPAIR in self._kinds
            sizes.append(sizes[0] if repaired else _HEADERS + _RECEIVER_REPORT + _SDES)
        sizes += [sizes[0]] * len(self._kinds & _OF_OUR_OWN)
        for size_bytes in sizes:
            self.timing.observe(size_bytes)
        return sizes

    def received(self, now_ns: int, feedback: Feedback) -> bool:
        """Feedback came; whether a keyframe it asks for is made.

        rtpsession ignores a request that follows the last one by less than two round trips.
        """
        self.timing.observe(feedback.size_bytes)
        for message in feedback.arrivals:
            self.timing.observe(message.size_bytes)
        if feedback.report_transit_ns is not None:
            exact_ns = feedback.report_transit_ns + now_ns - feedback.sent_ns
            self.round_trip_ns = round(round(exact_ns / _ROUND_TRIP_UNIT_NS) * _ROUND_TRIP_UNIT_NS)
        if not feedback.pli:
            return False
        round_trip_ns = self.round_trip_ns
        if round_trip_ns > _LONGEST_ROUND_TRIP_NS:
            round_trip_ns = NS_PER_S // 2
        last_ns = self._last_keyframe_ns
        if last_ns is not None and now_ns - last_ns < 2 * round_trip_ns:
            return False
        self._last_keyframe_ns = now_ns
        return True


def _nack_bytes(nacks: tuple[int, ...]) -> int:
    entries, reach = 0, -1
    first = nacks[0] if nacks else 0
    for ahead in sorted((sequence - first) % SEQUENCES for sequence in nacks):
        if ahead > reach:
            entries += 1
            reach = ahead + _NACK_REACH
    return _NACK + _NACK_ENTRY * entries if entries else 0


def _message_bytes(arrived_ns: list[int], count: int) -> int:
    waits = [(later - before) // ARRIVAL_TICK_NS for before, later in pairwise(arrived_ns)]
    long_waits = sum(wait > _SHORT_WAIT_TICKS for wait in waits)
    chunks = 1
    if long_waits or count > len(arrived_ns):
        chunks = -(-count // (_SHORT_VECTOR if long_waits else _LONG_VECTOR))
    size_bytes = _MESSAGE + _CHUNK * chunks + len(arrived_ns) + long_waits
    return _HEADERS + _FEEDBACK + -(-size_bytes // 4) * 4
