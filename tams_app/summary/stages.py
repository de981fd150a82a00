"""Where a frame's time goes from its capture to the screen."""

from __future__ import annotations

from typing import Any

import numpy as np

from tams_app.recording import SessionLog
from tams_app.records import PacketKind
from tams_app.summary.tables import Floats, PacketTable, capture_indices, percentiles
from tams_app.units import NS_PER_MS
from tams_app.video.core.stages import NETWORK, STAGES

_PERCENTILES = ("p50", "p95")


def latency_stages(log: SessionLog, view: str, packets: PacketTable) -> dict[str, Any]:
    """Of the frames of `view`, p50 and p95 [ms]: by stage of `STAGES`, and of all but the network.

    The sender has a frame until its last packet enters the uplink for the first time, the network
    until the jitter buffer has handed that out: it waits there for what was lost of this frame, or
    of one before it. Where no network was emulated the two clocks are not one, and null stands for
    both.
    """
    stages = dict(zip(STAGES, _columns(log, view, packets), strict=True))
    own = sum(values for stage, values in stages.items() if stage != NETWORK)
    return {
        "latency_stages_ms": {stage: _known(values) for stage, values in stages.items()},
        "own_latency_ms": _known(np.asarray(own)),
    }


def _known(values: Floats) -> dict[str, float | None]:
    return percentiles(values[~np.isnan(values)], _PERCENTILES)


def _columns(log: SessionLog, view: str, packets: PacketTable) -> tuple[Floats, ...]:
    """Of each frame that was sent or shown, what each stage took [ms]; NaN: not known."""
    shown = {one.index: one for one in log.shown if one.view == view}
    sent = {one.index: one for one in log.sent if one.view == view}
    entered_ns = _last_entered(log, view, packets)
    rows = []
    for index in sent.keys() | shown.keys():
        source, end = sent.get(index), shown.get(index)
        begun = (0, 0, 0, 0)
        if source is not None:
            begun = source.capture_ns, source.ready_ns, source.pushed_ns, source.encoded_ns
        ended = (0, 0) if end is None else (end.received_ns, end.shown_ns)
        rows.append((*begun, entered_ns.get(index, 0), *ended))
    times = np.array(rows, dtype=np.int64).reshape(len(rows), len(STAGES) + 1)
    took_ms: Floats = np.diff(times, axis=1) / NS_PER_MS
    took_ms[(times[:, 1:] <= 0) | (times[:, :-1] <= 0)] = np.nan
    return tuple(took_ms.T)


def _last_entered(log: SessionLog, view: str, packets: PacketTable) -> dict[int, int]:
    """By frame, when the last of its packets entered the uplink, resends left out."""
    if not log.packets:
        return {}
    indices = capture_indices(log, view)
    entered: dict[int, int] = {}
    media = (packets.kind == PacketKind.MEDIA.value) & (
        packets.view == log.header.views.index(view)
    )
    for stamp, entered_ns in zip(
        packets.rtp_timestamp[media].tolist(), packets.entered_ns[media].tolist(), strict=True
    ):
        index = indices.get(stamp, -1)
        entered[index] = max(entered_ns, entered.get(index, 0))
    return entered
