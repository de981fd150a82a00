"""summary.json, computed from the log alone: the same for a live session and for `report LOG`."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from tams_app.outputs import write_file
from tams_app.prediction.present import PREDICTED_FACT
from tams_app.recording import SessionLog
from tams_app.records import LATE_NS, Outcome, PacketKind
from tams_app.summary.operator import operator, prediction_errors, seen
from tams_app.summary.quality import QualityTable, primary_quality
from tams_app.summary.tables import (
    Integers,
    LogTables,
    Number,
    PacketTable,
    mean,
    percentiles,
    ratio,
    step_mean,
)
from tams_app.summary.views import rate_kbps, shortfall_of, view_entry
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.concealment import restored_packets

SCHEMA = 1
_BESIDE_MEDIA = {
    "resent_fraction": PacketKind.REPAIR,
    "parity_fraction": PacketKind.PARITY,
    "padding_fraction": PacketKind.PADDING,
}
SUMMARY_NAME = "summary.json"
BEFORE_NAME = "summary.json.before"


def summarise(log: SessionLog) -> dict[str, Any]:
    """`session_summary` of a log of which nothing else is asked."""
    return session_summary(LogTables(log))


def session_summary(tables: LogTables) -> dict[str, Any]:
    """The content of summary.json; keys are fixed, what was not measured is null.

    Definitions: docs/GLOSSARY.md, Measures. Means of rates are over the time in which
    targets were given and frames captured; `t_s` counts from the start of the session. Of the
    operator's side of two, `seen` has what its log tells alone.
    """
    log, quality = tables.log, QualityTable.of(tables)
    header = log.header
    views = {view: view_entry(tables, view, quality) for view in header.views}
    seen_here = seen(log)
    return {
        "schema": SCHEMA,
        "version": header.version,
        "seed": header.seed,
        "strategy": header.strategy,
        "network": header.network,
        "budget_mode": header.budget_mode,
        "codecs": {name: log.facts.get(name) for name in ("encoder", "decoder")},
        "predicted_views": [view for view in log.facts.get(PREDICTED_FACT, "").split(",") if view],
        "duration_s": round((log.ended_ns - header.started_ns) / NS_PER_S, 3),
        "complete": log.complete,
        "missing": _missing(log),
        "records_lost": sum(one.records for one in log.lost),
        "outcome": asdict(log.outcome or Outcome(None, None, None, None, "")),
        "episodes": episodes(log),
        "control": control(log),
        "arm": arm(log),
        "phases": phases(log),
        "uplink": uplink(tables),
        "views": views,
        "rates": {"shortfall": shortfall_of(log, views)},
        "primary_view": primary_quality(quality),
        "prediction": prediction_errors(log),
        "operator": operator(log),
        "system": _system(log),
        **({} if seen_here is None else {"seen": seen_here}),
    }


def save_summary(summary: dict[str, Any], folder: Path) -> None:
    """Write a summary into `folder`; LogError if it cannot.

    A complete summary is not lost to one of a log that has since been damaged: it is kept beside
    as `summary.json.before`.
    """
    text = json.dumps(summary, indent=2) + "\n"
    path = folder / SUMMARY_NAME
    if not summary["complete"] and _is_complete(path):
        write_file(folder / BEFORE_NAME, path.read_bytes())
    write_file(path, text)


def _missing(log: SessionLog) -> list[dict[str, Any]]:
    """From when to when the log has no records; `end_s` null: to the end, wherever that was."""
    return [
        {
            "start_s": None if gap.start_ns is None else seconds(log, gap.start_ns),
            "end_s": None if gap.end_ns is None else seconds(log, gap.end_ns),
        }
        for gap in log.missing
    ]


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
    """True if a summary is there that says so."""
    try:
        former = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return False
    return isinstance(former, dict) and former.get("complete") is True


def control(log: SessionLog) -> dict[str, Any]:
    """`late`: started more than 1 ms after due, or skipped; fractions are of all due ticks."""
    ticks = log.ticks
    due = np.array([tick.due_ns for tick in ticks], dtype=np.int64)
    started = np.array([tick.started_ns for tick in ticks], dtype=np.int64)
    finished = np.array([tick.finished_ns for tick in ticks], dtype=np.int64)
    skipped = np.array([tick.skipped for tick in ticks], dtype=np.int64)
    total_skipped = int(skipped[-1]) if ticks else 0
    late = int(np.sum(started - due > LATE_NS)) + total_skipped
    period_ns = NS_PER_S / log.header.control_rate_hz
    # a tick that the log lost (recorder too slow) must not read as a late one
    passed = np.round(np.diff(due) / period_ns) - 1
    neighbours = passed == np.diff(skipped)
    error_ns = np.abs(np.diff(started) - period_ns)[neighbours]
    return {
        "rate_hz": log.header.control_rate_hz,
        "ticks": len(ticks),
        "late": late,
        "skipped": total_skipped,
        "late_fraction": ratio(late, len(ticks) + total_skipped),
        "period_error_ms": percentiles(error_ns / NS_PER_MS, ("p50", "p99", "p99_9", "max")),
        "tick_cost_ms": percentiles((finished - started) / NS_PER_MS, ("p50", "p99", "max")),
        "scheduler": log.facts.get("scheduler"),
    }


def arm(log: SessionLog) -> dict[str, Any]:
    """Round trips of the commands that were acknowledged, and every stop that was not a release."""
    replies = {
        tick.link.acknowledged_ns: tick.link.round_trip_ns
        for tick in log.ticks
        if tick.link.acknowledged_ns > 0
    }
    round_trip_ms = np.array(list(replies.values()), dtype=np.float64) / NS_PER_MS
    return {
        "servo": log.header.servo,
        "round_trip_ms": percentiles(round_trip_ms, ("p50", "p99", "max")),
        "stops": [
            {
                "t_s": seconds(log, stop.visible_ns),
                "reason": stop.reason,
                "stop_time_ms": None if stop.rest_ms is None else round(stop.rest_ms, 3),
            }
            for stop in log.stops
        ],
    }


def episodes(log: SessionLog) -> list[dict[str, Any]]:
    """Each episode by its newest verdict."""
    return [
        {
            "number": one.number,
            "t_s": seconds(log, one.start_ns),
            "length_s": round((one.end_ns - one.start_ns) / NS_PER_S, 3),
            "kept": one.kept,
            "success": one.success,
        }
        for one in log.judged_episodes
    ]


def phases(log: SessionLog) -> list[dict[str, Any]]:
    """Each phase with its start and the line of Algorithm 1 that decided."""
    return [
        {
            "t_s": seconds(log, change.t_ns),
            "phase": change.phase.value,
            "reason": change.reason,
        }
        for change in log.phases
    ]


def seconds(log: SessionLog, t_ns: int) -> float:
    """Seconds since the session started."""
    return round(log.since_start_s(t_ns), 4)


def uplink(tables: LogTables) -> dict[str, Any]:
    """Null where the log has no packets or no capacity (none).

    Of a network that was not emulated receivers report all but what each packet carried.
    """
    packets, targets, span = tables.packets, tables.targets, tables.span
    capacity_kbps = _capacity_kbps(tables)
    video = packets.is_video
    crossed = packets.departed_ns > 0
    left_kbps = rate_kbps(packets, crossed, packets.departed_ns, span)  # RTCP with them
    sojourn_ms = (packets.departed_ns - packets.entered_ns)[crossed] / NS_PER_MS
    utilisation = None
    if left_kbps is not None and capacity_kbps is not None:
        utilisation = ratio(left_kbps, capacity_kbps)
    return {
        "capacity_kbps": capacity_kbps,
        "budget_kbps_mean": step_mean(targets.t_ns, targets.budget_kbps, span),
        "sent_kbps_mean": rate_kbps(packets, video, packets.entered_ns, span),
        "utilisation": utilisation,
        "queue_ms": percentiles(sojourn_ms, ("p50", "p95", "max")),
        "loss_fraction": ratio(
            int(np.sum(video)) - int(np.sum(packets.delivered[video])), int(np.sum(video))
        ),
        "residual_loss_fraction": _residual_loss(tables),
        **{name: _share_of_bytes(tables, kind) for name, kind in _BESIDE_MEDIA.items()},
    }


def _capacity_kbps(tables: LogTables) -> Number:
    capacities = tables.log.capacities
    times_ns = np.array([one.t_ns for one in capacities], dtype=np.int64)
    kbps = np.array([one.capacity_kbps for one in capacities], dtype=np.float64)
    if not np.all(np.isfinite(kbps)):
        return None  # no bottleneck
    return step_mean(times_ns, kbps, tables.span)


def _share_of_bytes(tables: LogTables, kind: PacketKind) -> Number:
    """The bytes of `kind` over those of video; null where packets are only reported."""
    if not tables.log.packets:
        return None
    packets = tables.packets
    of_kind = packets.size_bytes[packets.kind == kind.value]
    return ratio(int(np.sum(of_kind)), int(np.sum(packets.size_bytes[packets.is_video])))


def _residual_loss(tables: LogTables) -> Number:
    """Media packets that neither arrived in any transmission nor were restored."""
    if not tables.log.packets:
        return None
    packets = tables.packets
    media = packets.kind == PacketKind.MEDIA.value
    # A repair names the original's sequence and carries its RTP timestamp (RFC 4588), which tells
    # apart packets whose 16-bit sequence has wrapped.
    key = _keys(packets)
    sent = np.unique(key[media])
    carried = media | (packets.kind == PacketKind.REPAIR.value)
    restored = tables.table_of(restored_packets(tables.log.packets))
    arrived = np.union1d(key[carried & (packets.delivered == 1)], _keys(restored))
    missing = len(np.setdiff1d(sent, arrived, assume_unique=True))
    return ratio(missing, len(sent))


def _keys(packets: PacketTable) -> Integers:
    """One number per original packet: view (8 bit), RTP timestamp (32), sequence (16)."""
    return (packets.view << 48) | (packets.rtp_timestamp << 16) | packets.sequence
