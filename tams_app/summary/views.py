"""The entry of one view in summary.json: its frames, where their time goes, and what is missing."""

from __future__ import annotations

from collections.abc import Mapping
from operator import attrgetter
from types import MappingProxyType
from typing import Any

import numpy as np

from tams_app.recording import SessionLog
from tams_app.records import PacketKind
from tams_app.summary.quality import QualityTable, view_quality
from tams_app.summary.tables import (
    Flags,
    Floats,
    FrameTable,
    Integers,
    LogTables,
    Number,
    PacketTable,
    Span,
    mean,
    percentiles,
    step_mean,
)
from tams_app.summary.tracking import steps, tracking_error, windows
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.rate_control import freeze_ns
from tams_app.video.core.stages import NETWORK, STAGES

ENOUGH = 0.8  # of the frames a second that were asked for
_LEAST_FPS = 5  # that can be asked for


def view_entry(tables: LogTables, view: str, quality: QualityTable) -> dict[str, Any]:
    """All of one view; SSIM is null where the frames were not compared."""
    log, targets, span = tables.log, tables.targets, tables.span
    frames, packets = tables.frames[view], tables.packets
    mine = packets.is_video & (packets.view == tables.places[view])
    shown = frames.shown_ns > 0
    latency_ms = (frames.shown_ns - frames.capture_ns)[shown] / NS_PER_MS
    return {
        "target_kbps_mean": step_mean(targets.t_ns, targets.kbps[view], span),
        "sent_kbps_mean": rate_kbps(packets, mine, packets.entered_ns, span),
        "tracking_error": tracking_error(windows(tables, view), steps(targets, view)),
        "fps": {"asked": log.header.fps, "given": _frames_per_s(frames, span)},
        "frames_damaged_at_camera": sum(one.damaged.get(view, 0) for one in log.rates),
        "frame_interval_ms": percentiles(np.diff(frames.capture_ns) / NS_PER_MS, ("p50", "p95")),
        "frames_captured": len(frames.index),
        "frames_sent": sum(frame.view == view for frame in log.sent),
        "frames_left_out": sum(one.view == view and one.under_way for one in log.dropped),
        "frames_shown": int(np.sum(shown)),
        "latency_ms": percentiles(latency_ms, ("p50", "p95", "p99")),
        **latency_stages(tables, view),
        "freezes": _freezes(frames, span),
        "not_whole_s": _not_whole_s(log, view, span),
        **view_quality(log, view, quality),
    }


def rate_kbps(packets: PacketTable, chosen: Flags, at_ns: Integers, span: Span | None) -> Number:
    """Mean rate of the chosen packets whose `at_ns` is in the span; null without packets."""
    if span is None or not len(packets.size_bytes):
        return None
    inside = chosen & (at_ns >= span.start_ns) & (at_ns < span.end_ns)
    return round(float(np.sum(packets.size_bytes[inside])) * 8 / 1000 / span.seconds, 3)


def _frames_per_s(frames: FrameTable, span: Span | None) -> float | None:
    if span is None:
        return None
    first, end = np.searchsorted(frames.capture_ns, [span.start_ns, span.end_ns])
    return round(float(end - first) / span.seconds, 2)


def _freezes(frames: FrameTable, span: Span | None) -> dict[str, Any]:
    """Times for which the shown frame stayed the same for too long (`freeze_ns`).

    The last frame shown counts until the captures end; before the first there is nothing to freeze.
    """
    order = np.argsort(frames.shown_ns, kind="stable")
    order = order[frames.shown_ns[order] > 0]
    shown_ns = frames.shown_ns[order]
    if span is None or not len(shown_ns):
        return {"count": None, "total_s": None, "longest_s": None}
    gaps = np.diff(np.append(shown_ns, max(span.end_ns, int(shown_ns[-1]))))
    longest_ns = [freeze_ns(usual_ns) for usual_ns in frames.usual_ns[order].tolist()]
    frozen_s = gaps[gaps > longest_ns] / NS_PER_S
    return {
        "count": len(frozen_s),
        "total_s": round(float(np.sum(frozen_s)), 4),
        "longest_s": round(float(np.max(frozen_s, initial=0.0)), 4),
    }


def _not_whole_s(log: SessionLog, view: str, span: Span | None) -> float | None:
    """For how long the frame on the screen was not whole (`WholeChain`)."""
    shown = sorted((one for one in log.shown if one.view == view), key=attrgetter("shown_ns"))
    if span is None or not shown or any(one.whole is None for one in shown):
        return None
    until_ns = [*(one.shown_ns for one in shown[1:]), max(span.end_ns, shown[-1].shown_ns)]
    found_ns = sum(
        end_ns - one.shown_ns for one, end_ns in zip(shown, until_ns, strict=True) if not one.whole
    )
    return round(found_ns / NS_PER_S, 4)


def latency_stages(tables: LogTables, view: str) -> dict[str, Any]:
    """Of the frames of `view`, p50 and p95 [ms]: by stage of `STAGES`, and of all but the network.

    The sender has a frame until its last packet enters the uplink for the first time, the network
    until the jitter buffer has handed that out: it waits there for what was lost of this frame, or
    of one before it. Where no network was emulated the two clocks are not one, and null stands for
    both.
    """
    stages = dict(zip(STAGES, _stage_columns(tables, view), strict=True))
    own = sum(values for stage, values in stages.items() if stage != NETWORK)
    names = ("p50", "p95")
    return {
        "latency_stages_ms": {stage: percentiles(ms, names) for stage, ms in stages.items()},
        "own_latency_ms": percentiles(np.asarray(own), names),
    }


def _stage_columns(tables: LogTables, view: str) -> tuple[Floats, ...]:
    """Of each frame that was sent or shown, what each stage took [ms]; NaN: not known."""
    shown = {one.index: one for one in tables.log.shown if one.view == view}
    sent = {one.index: one for one in tables.log.sent if one.view == view}
    packets = tables.packets
    media = (packets.kind == PacketKind.MEDIA.value) & (packets.view == tables.places[view])
    order = np.argsort(packets.entered_ns[media], kind="stable")
    frame, entered_ns = packets.frame[media][order], packets.entered_ns[media][order]
    # of a frame's packets that of the last one stays
    last_entered_ns = dict(zip(frame.tolist(), entered_ns.tolist(), strict=True))
    rows = []
    for index in sent.keys() | shown.keys():
        source, end = sent.get(index), shown.get(index)
        begun = (0, 0, 0, 0)
        if source is not None:
            begun = source.capture_ns, source.ready_ns, source.pushed_ns, source.encoded_ns
        ended = (0, 0) if end is None else (end.received_ns, end.shown_ns)
        rows.append((*begun, last_entered_ns.get(index, 0), *ended))
    times = np.array(rows, dtype=np.int64).reshape(len(rows), len(STAGES) + 1)
    took_ms: Floats = np.diff(times, axis=1) / NS_PER_MS
    took_ms[(times[:, 1:] <= 0) | (times[:, :-1] <= 0)] = np.nan
    return tuple(took_ms.T)


def shortfall_of(log: SessionLog, views: Mapping[str, Mapping[str, Any]]) -> str | None:
    """The sentence on missing frames, None where every view was given enough.

    `views`: their entries in the summary.
    """
    given_fps = {view: entry["fps"]["given"] or 0.0 for view, entry in views.items()}
    if not log.captured or min(given_fps.values()) >= ENOUGH * log.header.fps:
        return None
    overrun_fps = {
        view: mean(np.array([one.overrun_fps.get(view, 0.0) for one in log.rates])) or 0.0
        for view in views
    }
    damaged = {view: entry["frames_damaged_at_camera"] for view, entry in views.items()}
    simulated = log.header.config.get("rig", {}).get("enabled", True)
    return shortfall(log.header.fps, given_fps, overrun_fps, simulated, damaged)


def shortfall(
    asked_fps: float,
    given_fps: Mapping[str, float],
    overrun_fps: Mapping[str, float],
    simulated: bool,
    damaged: Mapping[str, int] = MappingProxyType({}),
) -> str:
    """The cause of too few frames, and the remedy, in one sentence.

    Args:
        asked_fps: frames a second that were asked for.
        given_fps: by view, what came.
        overrun_fps: by view, what the camera had besides, which the session did not take.
        simulated: the cameras are the rig's.
        damaged: by view, how many came damaged and were left out.
    """
    given = ", ".join(f"{view} {fps:.1f}" for view, fps in given_fps.items())
    what = f"Too few frames: {given} per second of {asked_fps:g}"
    less_fps = max(int(min(given_fps.values())), _LEAST_FPS)
    less = f", or lower the rate with --fps {less_fps}" if less_fps < asked_fps else ""
    short = [view for view, fps in given_fps.items() if fps < ENOUGH * asked_fps]
    if all(given_fps[view] + overrun_fps.get(view, 0.0) >= ENOUGH * asked_fps for view in short):
        return f"{what}. The application missed the others: close other programs{less}."
    if simulated:
        return f"{what}. The machine rendered no more: close other programs{less}."
    if bad := [f"{count} of {view}" for view, count in damaged.items() if view in short and count]:
        return (
            f"{what}. Frames arrived damaged ({', '.join(bad)}) and were left out: check the "
            f"cables, or give each camera a USB port and bus of its own{less}."
        )
    return (
        f"{what}. The cameras delivered no more, as many do in dim light: add light or shorten "
        f"their exposure{less}."
    )
