"""The uplink's load in a stretch of time: one reckoning for screens, viewers and replays.

And the ways of packets by what receivers report: all that is known of a real network.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

from tams_app.records import PacketArrival, PacketFate, PacketKind, PacketRecord
from tams_app.units import NS_PER_MS, NS_PER_S

_UNPAID = (PacketKind.RTCP, PacketKind.PADDING)  # no view's target pays for them


@dataclass(frozen=True, slots=True)
class UplinkFigures:
    """None while nothing is known.

    sent_kbps: by view, with repair, without RTCP and padding. link_kbps: all views, with them.
    queue_ms, longest_queue_ms: time in the bottleneck, of the newest packet that left it and at
    most, without RTCP. loss: share of the media packets, and `view_loss` by view.
    """

    sent_kbps: Mapping[str, float | None]
    view_loss: Mapping[str, float | None]
    link_kbps: float | None = None
    queue_ms: float | None = None
    longest_queue_ms: float | None = None
    loss: float | None = None


def uplink_figures(
    packets: Sequence[PacketRecord], views: Sequence[str], span_ns: int
) -> UplinkFigures:
    """Of the packets that entered in a stretch of `span_ns`, in the order of entering."""
    if not packets:
        return UplinkFigures(dict.fromkeys(views), dict.fromkeys(views))
    bits = dict.fromkeys(views, 0)
    media: dict[str, list[PacketFate]] = {view: [] for view in views}
    waits_ns: list[int] = []
    for packet in packets:
        if packet.kind not in _UNPAID:
            bits[packet.view] += packet.size_bytes * 8
        if packet.kind is PacketKind.MEDIA:
            media[packet.view].append(packet.fate)
        if packet.departed_ns and packet.kind is not PacketKind.RTCP:
            waits_ns.append(packet.departed_ns - packet.entered_ns)
    per_kbps = 1000 * span_ns / NS_PER_S
    return UplinkFigures(
        sent_kbps={view: bits[view] / per_kbps for view in views},
        view_loss={view: _loss(fates) for view, fates in media.items()},
        link_kbps=sum(packet.size_bytes * 8 for packet in packets) / per_kbps,
        queue_ms=waits_ns[-1] / NS_PER_MS if waits_ns else None,
        longest_queue_ms=max(waits_ns) / NS_PER_MS if waits_ns else None,
        loss=_loss([fate for fates in media.values() for fate in fates]),
    )


def _loss(fates: Iterable[PacketFate]) -> float | None:
    lost = [fate is not PacketFate.DELIVERED for fate in fates]
    return sum(lost) / len(lost) if lost else None


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
