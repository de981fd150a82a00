"""The ways of packets, by what receivers report of them: all that is known of a real network."""

from __future__ import annotations

from collections.abc import Sequence

from tams_app.records import PacketArrival, PacketFate, PacketKind, PacketRecord


class ReportedPackets:
    """Takes arrivals in the order of sending, and remembers the fastest.

    What is not reported: what a packet carried (all are called media, also resends, parity and
    padding) and how long the fastest took. A way is the time in the bottleneck: what it took
    longer.
    """

    def __init__(self) -> None:
        self._least_transit_ns: int | None = None

    def step(self, arrivals: Sequence[PacketArrival]) -> list[PacketRecord]:
        """Those of one report, from whose fastest packet on the time counts, too."""
        transits = [one.arrived_ns - one.sent_ns for one in arrivals if one.arrived_ns is not None]
        if self._least_transit_ns is not None:
            transits.append(self._least_transit_ns)
        self._least_transit_ns = least_ns = min(transits, default=None)
        return [_way(one, least_ns or 0) for one in arrivals]


def _way(arrival: PacketArrival, least_ns: int) -> PacketRecord:
    came = arrival.arrived_ns is not None
    out_ns = 0 if arrival.arrived_ns is None else arrival.arrived_ns - least_ns
    return PacketRecord(
        view=arrival.view,
        kind=PacketKind.MEDIA,
        sequence=0,
        size_bytes=arrival.size_bytes,
        entered_ns=arrival.sent_ns,
        departed_ns=out_ns,
        delivered_ns=out_ns,
        fate=PacketFate.DELIVERED if came else PacketFate.LOST,
    )
