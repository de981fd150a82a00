"""The uplink's load at this moment: by the packets' fates, or by receivers' reports."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Sequence

from tams_app.records import (
    PacketFate,
    PacketRecord,
    UplinkReport,
    UplinkSummary,
)
from tams_app.units import NS_PER_S
from tams_app.video.core.uplink_figures import UplinkFigures, uplink_figures

WINDOW_NS = NS_PER_S
_OLD_NS = 2 * NS_PER_S  # what is known of so long ago says nothing of now


class UplinkMeter:
    """Figures of the last second; each method from any thread.

    An emulated network knows each packet's fate (`packets`), and then nothing else counts. Of a
    real one there is only what receivers report (`reported`), half a round trip later.
    """

    def __init__(self, views: tuple[str, ...]) -> None:
        self._views = views
        self._lock = threading.Lock()
        self._packets: deque[PacketRecord] = deque()
        self._emulated = False

    @property
    def emulated(self) -> bool:
        """Whether the network is emulated: what receivers report does not count then."""
        return self._emulated

    def packets(self, packets: Sequence[PacketRecord]) -> None:
        """Newly decided packet fates; those older than the window are forgotten."""
        with self._lock:
            if not self._emulated:
                self._emulated = True
                self._packets.clear()
            self._add(packets)

    def report(self, packets: Sequence[PacketRecord]) -> None:
        """Count the packets that receivers have reported."""
        with self._lock:
            if not self._emulated:
                self._add(packets)

    def figures(self, now_ns: int) -> UplinkFigures:
        """As far as they are known."""
        with self._lock:
            packets = list(self._packets)
        if packets and now_ns - packets[-1].entered_ns > _OLD_NS:
            packets = []
        return uplink_figures(packets, self._views, WINDOW_NS)

    def _add(self, packets: Sequence[PacketRecord]) -> None:
        self._packets.extend(packets)
        oldest_ns = self._packets[-1].entered_ns - WINDOW_NS if self._packets else 0
        while self._packets and self._packets[0].entered_ns < oldest_ns:
            self._packets.popleft()


def summary_of(report: UplinkReport, reported: Sequence[PacketRecord]) -> UplinkSummary:
    """The sums of a report of the uplink; `reported`: its arrivals (`ReportedPackets`)."""
    came = [one for one in reported if one.fate is PacketFate.DELIVERED]
    newest = came[-1] if came else None
    return UplinkSummary(
        t_ns=report.now_ns,
        sent_bytes=report.sent_bytes,
        packets=len(reported),
        lost=len(reported) - len(came),
        arrived_bytes=sum(one.size_bytes for one in came),
        newest_sent_ns=None if newest is None else newest.entered_ns,
        queueing_ns=None if newest is None else newest.departed_ns - newest.entered_ns,
        fraction_lost={one.view: one.fraction_lost for one in report.receptions},
        round_trip_ns={one.view: one.round_trip_ns for one in report.receptions},
    )
