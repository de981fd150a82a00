"""A receiver's reports in RTCP: report blocks (RFC 3550) and transport-wide feedback.

The latter is draft-holmer-rmcat-transport-wide-cc-extensions-01: when each packet arrived, by a
sequence number that runs over media and repair of one RTP session.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

from tams_app.units import NS_PER_MS, NS_PER_S
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
