"""The bottleneck all views share: rates, queue, loss. Kbit/s of IP datagram bytes."""

from __future__ import annotations

from typing import Any

import numpy as np

from tams_app.recording import SessionLog
from tams_app.records import PacketKind
from tams_app.summary.tables import (
    Flags,
    Integers,
    Number,
    PacketTable,
    Span,
    Targets,
    percentiles,
    ratio,
    step_mean,
)
from tams_app.units import NS_PER_MS


def uplink(
    log: SessionLog, packets: PacketTable, targets: Targets, span: Span | None
) -> dict[str, Any]:
    """Null where the log has no packets (an uplink that is not ours) or no capacity (none)."""
    capacity_kbps = _capacity_kbps(log, span)
    video = packets.is_video
    crossed = packets.departed_ns > 0
    sojourn_ms = (packets.departed_ns - packets.entered_ns)[crossed] / NS_PER_MS
    return {
        "capacity_kbps": capacity_kbps,
        "budget_kbps_mean": span
        and step_mean(targets.t_ns, targets.budget_kbps, span.start_ns, span.end_ns),
        "sent_kbps_mean": rate_kbps(packets, video, packets.entered_ns, span),
        "utilisation": _utilisation(packets, crossed, capacity_kbps, span),
        "queue_ms": percentiles(sojourn_ms, ("p50", "p95", "max")),
        "loss_fraction": ratio(
            int(np.sum(video)) - int(np.sum(packets.delivered[video])), int(np.sum(video))
        ),
        "residual_loss_fraction": _residual_loss(packets),
    }


def rate_kbps(packets: PacketTable, chosen: Flags, at_ns: Integers, span: Span | None) -> Number:
    """Mean rate of the chosen packets whose `at_ns` is in the span; null without packets."""
    if span is None or not len(packets.size_bytes):
        return None
    inside = chosen & (at_ns >= span.start_ns) & (at_ns < span.end_ns)
    return round(float(np.sum(packets.size_bytes[inside])) * 8 / 1000 / span.seconds, 3)


def _capacity_kbps(log: SessionLog, span: Span | None) -> Number:
    if span is None or not log.capacities:
        return None
    times_ns = np.array([one.t_ns for one in log.capacities], dtype=np.int64)
    kbps = np.array([one.capacity_kbps for one in log.capacities], dtype=np.float64)
    if not np.all(np.isfinite(kbps)):
        return None  # no bottleneck
    return step_mean(times_ns, kbps, span.start_ns, span.end_ns)


def _utilisation(
    packets: PacketTable, crossed: Flags, capacity_kbps: Number, span: Span | None
) -> Number:
    """Bytes that left the bottleneck, RTCP with them, over the integral of the capacity."""
    left_kbps = rate_kbps(packets, crossed, packets.departed_ns, span)
    if left_kbps is None or capacity_kbps is None:
        return None
    return ratio(left_kbps, capacity_kbps)


def _residual_loss(packets: PacketTable) -> Number:
    """Media packets of which no transmission, the repairs included, was delivered."""
    media = packets.kind == PacketKind.MEDIA.value
    # A repair names the original's sequence and carries its RTP timestamp (RFC 4588), which tells
    # apart packets whose 16-bit sequence has wrapped.
    key = _keys(packets)
    sent = np.unique(key[media])
    arrived = np.unique(key[packets.is_video & (packets.delivered == 1)])
    missing = len(np.setdiff1d(sent, arrived, assume_unique=True))
    return ratio(missing, len(sent))


def _keys(packets: PacketTable) -> Integers:
    """One number per original packet: view (8 bit), RTP timestamp (32), sequence (16)."""
    return (packets.view << 48) | (packets.rtp_timestamp << 16) | packets.sequence
