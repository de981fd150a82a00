"""A receiver's feedback: what its RTCP says, and how it is handed to the thread that asks.

RTCP has report blocks (RFC 3550) and transport-wide feedback. The latter is
draft-holmer-rmcat-transport-wide-cc-extensions-01: when each packet arrived, by a sequence number
that runs over media and repair of one RTP session.
"""

from __future__ import annotations

import struct
from collections import deque
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from operator import attrgetter

from tams_app.records import PacketArrival, Reception, UplinkReport
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.frame_identity import RTP_CLOCK_HZ
from tams_app.video.core.packets import SEQUENCES

ARRIVAL_TICK_NS = 250_000  # the unit of arrival times

_REPORT_TYPES = {200: 28, 201: 8}  # packet type -> where the report blocks begin
_BLOCK = struct.Struct("!IIIIII")
_MESSAGE = struct.Struct("!HHI")  # first sequence number, how many, reference time and count
_REFERENCE_NS = 64 * NS_PER_MS
_LOST, _SMALL_DELTA, _LARGE_DELTA = 0, 1, 2
_ONLY_LOST = (b"\x80\x00", b"\xc0\x00")  # vectors of 14 or 7 packets
_NTP_EPOCH_NS = 2_208_988_800 * NS_PER_S  # 1900 to 1970
_LONGEST_ROUND_TRIP_NS = 10 * NS_PER_S
# Both 16 bits of ticks within a message and 24 bits of 64 ms over all are whole multiples of it.
_WRAP_NS = ARRIVAL_TICK_NS << 16
_OLDEST_NS = 10 * NS_PER_S
_KEPT = 20_000  # seconds of packets; the policy asks 20 times a second


@dataclass(frozen=True, slots=True)
class ReportBlock:
    """A receiver's figures of one stream since its start."""

    ssrc: int
    lost: int
    highest_sequence: int  # with the cycles before it: one more than this were expected
    jitter: int  # in units of the RTP clock
    round_trip_ns: int | None  # None: no report of the sender has come there yet


def read_blocks(datagram: bytes, wall_ns: int) -> list[ReportBlock]:
    """The report blocks of a compound datagram that came at `wall_ns` [ns since 1970]."""
    blocks: list[ReportBlock] = []
    for kind, count, packet in _packets(datagram):
        if kind in _REPORT_TYPES:
            first = _REPORT_TYPES[kind]
            ends = range(first + _BLOCK.size, len(packet) + 1, _BLOCK.size)
            blocks += [_block(packet, end - _BLOCK.size, wall_ns) for end in ends[:count]]
    return blocks


def read_arrivals(message: bytes) -> dict[int, int]:
    """The arrivals [ns] in a message, by transport-wide sequence number.

    Lost ones are absent, and all are if the message is cut off. The times count from an unknown
    instant; a wait of more than 8 s within a message shortens what follows by multiples of 16.4 s.
    """
    if len(message) < _MESSAGE.size:
        return {}
    first, count, reference = _MESSAGE.unpack_from(message)
    statuses, at = _statuses(message, count)
    deltas = statuses.count(_SMALL_DELTA) + 2 * statuses.count(_LARGE_DELTA)
    if len(statuses) < count or at + deltas > len(message):
        return {}
    arrivals: dict[int, int] = {}
    arrived_ns = (reference >> 8) * _REFERENCE_NS
    for place, status in enumerate(statuses):
        if status not in (_SMALL_DELTA, _LARGE_DELTA):
            continue
        delta = int.from_bytes(message[at : at + status], signed=status == _LARGE_DELTA)
        at += status  # its number is the number of its bytes
        arrived_ns += delta * ARRIVAL_TICK_NS
        arrivals[(first + place) % SEQUENCES] = arrived_ns
    return arrivals


def _statuses(message: bytes, count: int) -> tuple[list[int], int]:
    """The status of each packet, and where the arrival times begin.

    GStreamer 1.22 writes a gap that is longer than a vector twice: as a run of lost packets, then
    as vectors, the first of which has no other. A gap that is written once never goes on so.
    """
    statuses: list[int] = []
    at = _MESSAGE.size
    while len(statuses) < count and at + 2 <= len(message):
        chunk = int.from_bytes(message[at : at + 2])
        at += 2
        if chunk & 0x8000 == 0:
            status, run = chunk >> 13, chunk & 0x1FFF
            again = message[at : at + 2] in _ONLY_LOST and len(statuses) + run < count
            if status != _LOST or not again:
                statuses += [status] * run
        elif chunk & 0x4000:
            statuses += [chunk >> shift & 3 for shift in range(12, -1, -2)]
        else:
            statuses += [chunk >> shift & 1 for shift in range(13, -1, -1)]
    return statuses[:count], at


def _packets(datagram: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Type, count or format, and bytes of each whole packet."""
    at = 0
    while at + 4 <= len(datagram):
        end = at + 4 + 4 * int.from_bytes(datagram[at + 2 : at + 4])
        if end <= len(datagram):
            yield datagram[at + 1], datagram[at] & 0x1F, datagram[at:end]
        at = end


def _block(packet: bytes, at: int, wall_ns: int) -> ReportBlock:
    ssrc, losses, highest, jitter, last_report, since = _BLOCK.unpack_from(packet, at)
    lost = losses & 0xFFFFFF
    lost -= (lost & 0x800000) << 1  # a signed number of 24 bits
    round_trip_ns = None
    if last_report:
        now = ((wall_ns + _NTP_EPOCH_NS) << 16) // NS_PER_S  # in 1/65536 s, as the other two
        gone_ns = ((now - last_report - since) % (1 << 32)) * NS_PER_S >> 16
        round_trip_ns = gone_ns if gone_ns < _LONGEST_ROUND_TRIP_NS else None  # a clock was set
    return ReportBlock(ssrc, lost, highest, jitter, round_trip_ns)


class ReceivedFeedback:
    """Arrivals and receptions of one view; `report` and `blocks` from one thread, `take` from any.

    GStreamer's session forgets what was reported, so that of feedback that comes late only the
    newest counts; after 65,536 packets without any it takes packets for earlier ones, which are
    left out here.
    """

    def __init__(self, view: str, media_ssrc: int) -> None:
        self._view = view
        self._media_ssrc = media_ssrc
        self._arrivals: deque[PacketArrival] = deque(maxlen=_KEPT)
        self._newest = (0, 0)  # sent_ns and sequence number
        self._transit_ns: int | None = None
        self._block: ReportBlock | None = None
        self._reported: ReportBlock | None = None

    @property
    def newest_sent_ns(self) -> int:
        """The time at which the newest reported packet left; 0 before the first."""
        return self._newest[0]

    def report(
        self, now_ns: int, packets: Iterable[tuple[int, int, int]], arrived_ns: Mapping[int, int]
    ) -> None:
        """A message has come that reports `packets`: sequence number, sent_ns, size in bytes.

        `arrived_ns`: by sequence number, of those that arrived, modulo 16.4 s.
        """
        for sequence, sent_ns, size_bytes in packets:
            if now_ns - _OLDEST_NS < sent_ns <= now_ns and self._is_new(sent_ns, sequence):
                self._newest = (sent_ns, sequence)
                arrived = arrived_ns.get(sequence)
                if arrived is not None:
                    arrived = sent_ns + self._transit(arrived - sent_ns)
                self._arrivals.append(PacketArrival(self._view, sent_ns, size_bytes, arrived))

    def blocks(self, blocks: Iterable[ReportBlock]) -> None:
        for block in blocks:
            if block.ssrc == self._media_ssrc:
                if self._block is None:  # GStreamer may count a stream's start as 65,536 losses
                    self._reported = block
                self._block = block

    def take_arrivals(self) -> list[PacketArrival]:
        """The arrivals reported since the last call, in the order of sending."""
        return [self._arrivals.popleft() for _ in range(len(self._arrivals))]

    def take_reception(self) -> Reception | None:
        """The newest report, if one came since the last call."""
        block, before = self._block, self._reported
        if block is None or before is None or block is before:
            return None
        self._reported = block
        expected = block.highest_sequence - before.highest_sequence
        lost = max(0, block.lost - before.lost)  # a late packet takes one back
        return Reception(
            self._view,
            min(1.0, lost / expected) if expected > 0 else 0.0,
            block.round_trip_ns,
            block.jitter * NS_PER_S // RTP_CLOCK_HZ,
        )

    def _is_new(self, sent_ns: int, sequence: int) -> bool:
        newest_ns, newest = self._newest
        if sent_ns != newest_ns:
            return sent_ns > newest_ns
        return 0 < (sequence - newest) % SEQUENCES < SEQUENCES // 2

    def _transit(self, transit_ns: int) -> int:
        """As near as can be to that of the packet before: no queue holds a packet for 8 s."""
        if self._transit_ns is not None:
            transit_ns += round((self._transit_ns - transit_ns) / _WRAP_NS) * _WRAP_NS
        self._transit_ns = transit_ns
        return transit_ns


_sent_ns = attrgetter("sent_ns")


def uplink_report(
    now_ns: int, sent_bytes: int, received: Sequence[ReceivedFeedback]
) -> UplinkReport:
    """The report of all views, each packet in the order of sending."""
    arrivals = [arrival for one in received for arrival in one.take_arrivals()]
    arrivals.sort(key=_sent_ns)
    receptions = (one.take_reception() for one in received)
    reported = tuple(one for one in receptions if one is not None)
    return UplinkReport(now_ns, sent_bytes, tuple(arrivals), reported)
