"""summary.json, computed from the log alone: the same for a live session and for `report LOG`."""

from __future__ import annotations

import json
import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from tams_app.errors import LogError
from tams_app.recording import Gap, SessionLog
from tams_app.records import Outcome
from tams_app.summary.control import arm, control, phases, seconds
from tams_app.summary.operator import operator
from tams_app.summary.quality import QualityTable, primary_quality, view_quality
from tams_app.summary.tables import (
    FrameTable,
    PacketTable,
    Span,
    Targets,
    mean,
    percentiles,
    step_mean,
)
from tams_app.summary.tracking import steps, tracking_error, windows
from tams_app.summary.uplink import rate_kbps, uplink
from tams_app.units import NS_PER_MS, NS_PER_S

SCHEMA = 1
FREEZE_NS = 200 * NS_PER_MS
SUMMARY_NAME = "summary.json"
BEFORE_NAME = "summary.json.before"


def summarise(log: SessionLog) -> dict[str, Any]:
    """The content of summary.json; keys are fixed, what was not measured is null.

    Definitions: docs/GLOSSARY.md, Measures. Means of rates are over the time in which
    targets were given and frames captured; `t_s` counts from the start of the session.
    """
    header = log.header
    packets, targets, span = PacketTable.of(log), Targets.of(log), Span.of(log)
    quality = QualityTable.of(log)
    return {
        "schema": SCHEMA,
        "version": header.version,
        "seed": header.seed,
        "strategy": header.strategy,
        "network": header.network,
        "budget_mode": header.budget_mode,
        "duration_s": round((log.ended_ns - header.started_ns) / NS_PER_S, 3),
        "complete": log.complete,
        "missing": _missing(log),
        "outcome": _outcome(log),
        "control": control(log),
        "arm": arm(log),
        "phases": phases(log),
        "uplink": uplink(log, packets, targets, span),
        "views": {view: _view(log, view, packets, targets, quality, span) for view in header.views},
        "primary_view": primary_quality(log, quality),
        "operator": operator(log),
        "system": _system(log),
    }


def save_summary(log: SessionLog, folder: Path) -> dict[str, Any]:
    """Compute the summary of `log`, write it into `folder` and return it; LogError if it cannot.

    A complete summary is not lost to one of a log that has since been damaged: it is kept beside
    as `summary.json.before`.
    """
    summary = summarise(log)
    text = json.dumps(summary, indent=2) + "\n"
    path = folder / SUMMARY_NAME
    try:
        if not log.complete and _is_complete(path):
            os.replace(path, folder / BEFORE_NAME)
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise LogError(f"{folder}: the summary cannot be written: {error.strerror}") from error
    return summary


def _view(
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


def _missing(log: SessionLog) -> list[dict[str, Any]]:
    """From when to when the log has no records; `end_s` null: to the end, wherever that was."""
    gaps = [*log.gaps, *([Gap(log.ended_ns, None)] if log.truncated else [])]
    return [
        {
            "start_s": None if gap.start_ns is None else seconds(log, gap.start_ns),
            "end_s": None if gap.end_ns is None else seconds(log, gap.end_ns),
        }
        for gap in gaps
    ]


def _outcome(log: SessionLog) -> dict[str, Any]:
    return asdict(log.outcome or Outcome(None, None, None, None, ""))


def _system(log: SessionLog) -> dict[str, Any]:
    """CPU in percent of one core, helpers summed."""
    app = np.array([sample.app_cpu_percent for sample in log.system], dtype=np.float64)
    helpers = np.array(
        [sum(sample.helper_cpu_percent.values()) for sample in log.system], dtype=float
    )
    return {
        "cpu_percent": {"app": mean(app), "helpers": mean(helpers)},
        "peak_rss_mb": max((sample.rss_mb for sample in log.system), default=None),
    }


def _is_complete(path: Path) -> bool:
    """Whether a summary is there that says nothing else; up to 0.1 they did not say."""
    try:
        former = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(former, dict) and former.get("complete", True) is True
