"""Where a frame's time goes from its capture to the screen."""

from __future__ import annotations

from typing import Any

import numpy as np

from tams_app.recording import SessionLog
from tams_app.records import PacketKind
from tams_app.summary.tables import Floats, FrameTable, PacketTable, capture_indices, percentiles
from tams_app.units import NS_PER_MS

# By the key in summary.json, what a stage is in words; in their order.
STAGES = {
    "to_encoder": "camera to encoder",
    "encoder": "encoder",
    "sender": "pacing at the sender",
    "network": "network and repair",
    "receiver": "jitter buffer and decoder",
}
OURS = tuple(stage for stage in STAGES if stage != "network")
_CARRIES = (PacketKind.MEDIA.value, PacketKind.REPAIR.value)


def latency_stages(
    log: SessionLog, view: str, frames: FrameTable, packets: PacketTable
) -> dict[str, Any]:
    """By stage of `STAGES`, p50 and p95 of the frames of `view` [ms].

    The sender has a frame until its last packet enters the uplink, the network until the last one
    that had come when it was shown is delivered, be it one that was sent again. Network and
    receiver are null where no network was emulated: there the two clocks are not one.
    """
    columns = _columns(log, view, frames, packets)
    return {
        stage: percentiles(values[~np.isnan(values)], ("p50", "p95"))
        for stage, values in zip(STAGES, columns, strict=True)
    }


def slowest_stage(stages: dict[str, Any]) -> str | None:
    """The stage beside the network that takes longest at p95; None: nothing is known."""
    known = {stage: stages[stage]["p95"] for stage in OURS if stages[stage]["p95"] is not None}
    return max(known, key=lambda stage: known[stage]) if known else None


def _columns(
    log: SessionLog, view: str, frames: FrameTable, packets: PacketTable
) -> tuple[Floats, ...]:
    """Of each frame that was sent, what each stage took [ms]; NaN: not known."""
    shown_ns = {
        index: t_ns
        for index, t_ns in zip(frames.index.tolist(), frames.shown_ns.tolist(), strict=True)
        if t_ns > 0
    }
    entered_ns, delivered_ns = _last_packets(log, view, packets, shown_ns)
    rows = [
        (
            one.capture_ns,
            one.pushed_ns or np.nan,
            one.encoded_ns,
            entered_ns.get(one.index, np.nan),
            delivered_ns.get(one.index, np.nan),
            shown_ns.get(one.index, np.nan),
        )
        for one in log.sent
        if one.view == view
    ]
    times = np.array(rows, dtype=np.float64).reshape(len(rows), len(STAGES) + 1)
    return tuple(np.diff(times, axis=1).T / NS_PER_MS)


def _last_packets(
    log: SessionLog, view: str, packets: PacketTable, shown_ns: dict[int, int]
) -> tuple[dict[int, int], dict[int, int]]:
    """By frame, when its last packet entered the uplink, and when the last came that counted."""
    if not log.packets:
        return {}, {}
    indices = capture_indices(log, view)
    entered: dict[int, int] = {}
    delivered: dict[int, int] = {}
    carries = np.isin(packets.kind, _CARRIES) & (packets.view == log.header.views.index(view))
    for kind, stamp, entered_ns, delivered_ns in zip(
        packets.kind[carries].tolist(),
        packets.rtp_timestamp[carries].tolist(),
        packets.entered_ns[carries].tolist(),
        packets.delivered_ns[carries].tolist(),
        strict=True,
    ):
        index = indices.get(stamp, -1)
        if kind == PacketKind.MEDIA.value:
            entered[index] = max(entered_ns, entered.get(index, 0))
        if 0 < delivered_ns <= shown_ns.get(index, 0):
            delivered[index] = max(delivered_ns, delivered.get(index, 0))
    return entered, delivered
