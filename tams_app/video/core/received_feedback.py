"""Feedback that senders have received, handed to the thread that asks; what all senders share."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from operator import attrgetter

from tams_app.records import PacketArrival, Reception, UplinkReport
from tams_app.units import NS_PER_S
from tams_app.video.core.frame_identity import RTP_CLOCK_HZ
from tams_app.video.core.pacer import Pacer
from tams_app.video.core.packets import SEQUENCES
from tams_app.video.core.parity import ViewParity
from tams_app.video.core.rtcp import ARRIVAL_TICK_NS, ReportBlock

# Both 16 bits of ticks within a message and 24 bits of 64 ms over all are whole multiples of it.
_WRAP_NS = ARRIVAL_TICK_NS << 16
_OLDEST_NS = 10 * NS_PER_S
_KEPT = 20_000  # seconds of packets; the policy asks 20 times a second


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


@dataclass(frozen=True, slots=True)
class Uplink:
    """What the senders of all views share.

    Attributes:
        received: by view, gets what its receiver reports; others are not asked.
        feedback: packets are numbered, and receivers report when each came: both must agree.
        parity: protects the frames of these views, where `RepairRule.parity` lets it.
        may_resend: asked with its size before a packet is sent again, where `feedback`.
        pacer: says when the packets of each frame leave; None: at once.
    """

    received: Mapping[str, ReceivedFeedback] = field(default_factory=dict)
    feedback: bool = False
    parity: Mapping[str, ViewParity] = field(default_factory=dict)
    may_resend: Callable[[int], bool] = lambda _size_bytes: True
    pacer: Pacer | None = None
