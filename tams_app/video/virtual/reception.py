"""The state of a receiver in virtual time, as GStreamer's rtpsession keeps it."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

from tams_app.units import NS_PER_S
from tams_app.video.core.packets import SEQUENCES, RtpHeader
from tams_app.video.core.rtcp import ARRIVAL_TICK_NS, ReportBlock

_RTP_CLOCK_HZ = 90_000
# Without the end of a frame, that many lost packets after so many that came make a message, too.
_LOST_WITHOUT_END, _CAME_WITHOUT_END = 60, 10
_HEADERS, _MESSAGE, _CHUNK = 28 + 12, 8, 2  # IP, UDP and RTCP; sizes in bytes
_SHORT_WAIT_TICKS, _SHORT_VECTOR, _LONG_VECTOR = 255, 7, 14


@dataclass(frozen=True, slots=True)
class ArrivalMessage:
    """A datagram that reports the packets up to `last`, by transport-wide sequence number."""

    last: int
    arrived_ns: dict[int, int]  # of those that arrived
    size_bytes: int  # IP datagram


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
        size_bytes = _size_bytes(list(self._arrived.values()), count)
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
        transit = now_ns * _RTP_CLOCK_HZ // NS_PER_S - header.timestamp
        if self._transit is not None:
            self._jitter += abs(transit - self._transit) - (self._jitter + 8 >> 4)
        self._transit = transit

    def block(self, ssrc: int) -> ReportBlock:
        """The block of a report that leaves now; the round trip is for the sender to know."""
        lost = self._highest + 1 - self._received
        return ReportBlock(ssrc, lost, self._highest, self._jitter >> 4, None)


def _size_bytes(arrived_ns: list[int], count: int) -> int:
    waits = [(later - before) // ARRIVAL_TICK_NS for before, later in pairwise(arrived_ns)]
    long_waits = sum(wait > _SHORT_WAIT_TICKS for wait in waits)
    chunks = 1
    if long_waits or count > len(arrived_ns):
        chunks = -(-count // (_SHORT_VECTOR if long_waits else _LONG_VECTOR))
    size_bytes = _MESSAGE + _CHUNK * chunks + len(arrived_ns) + long_waits
    return _HEADERS + -(-size_bytes // 4) * 4
