"""Each view: rates, frames, latency, freezes, quality."""

from __future__ import annotations

from typing import Any

import numpy as np

from tams_app.recording import SessionLog
from tams_app.summary.numbers import percentiles, step_mean
from tams_app.summary.quality import QualityTable, view_quality
from tams_app.summary.tables import FrameTable, PacketTable, Span, Targets
from tams_app.summary.tracking import steps, tracking_error, windows
from tams_app.summary.uplink import rate_kbps
from tams_app.units import NS_PER_MS, NS_PER_S

FREEZE_NS = 200 * NS_PER_MS


def view_summary(
    log: SessionLog,
    view: str,
    packets: PacketTable,
    targets: Targets,
    quality: QualityTable,
    span: Span | None,
) -> dict[str, Any]:
    """The entry of one view; SSIM is null where the frames were not compared."""
    frames = FrameTable.of(log, view)
    mine = packets.is_video & (packets.view == log.header.views.index(view))
    shown = frames.shown_ns > 0
    latency_ms = (frames.shown_ns - frames.capture_ns)[shown] / NS_PER_MS
    found = windows(log, view, frames, packets, targets)
    return {
        "target_kbps_mean": span
        and step_mean(targets.t_ns, targets.kbps[view], span.start_ns, span.end_ns),
        "sent_kbps_mean": rate_kbps(packets, mine, packets.entered_ns, span),
        "tracking_error": tracking_error(found, steps(targets, view)),
        "frames_captured": len(frames.index),
        "frames_sent": sum(frame.view == view for frame in log.sent),
        "frames_shown": int(np.sum(shown)),
        "latency_ms": percentiles(latency_ms, ("p50", "p95", "p99")),
        "freezes": _freezes(frames, span),
        **view_quality(log, view, quality),
    }


def _freezes(frames: FrameTable, span: Span | None) -> dict[str, Any]:
    """Times for which the shown frame stayed the same for more than 200 ms.

    The last frame shown counts until the captures end; before the first there is nothing to freeze.
    """
    shown_ns = np.sort(frames.shown_ns[frames.shown_ns > 0])
    if span is None or not len(shown_ns):
        return {"count": None, "total_s": None, "longest_s": None}
    gaps = np.diff(np.append(shown_ns, max(span.end_ns, int(shown_ns[-1]))))
    frozen_s = gaps[gaps > FREEZE_NS] / NS_PER_S
    return {
        "count": len(frozen_s),
        "total_s": round(float(np.sum(frozen_s)), 4),
        "longest_s": round(float(np.max(frozen_s, initial=0.0)), 4),
    }
