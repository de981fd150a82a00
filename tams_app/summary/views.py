"""The entry of one view in summary.json: frames, where time goes, tracking, what is missing."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
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
    Targets,
    last_before,
    mean,
    percentiles,
    step_mean,
)
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.rate_control import STEP_FRACTION, WINDOW_FRAMES, WINDOW_NS, freeze_ns
from tams_app.video.core.stages import NETWORK, STAGES

ENOUGH = 0.8  # of the frames a second that were asked for
_LEAST_FPS = 5  # that can be asked for
LEFT_OUT_NS = 500 * NS_PER_MS  # after a step
GAP_INTERVALS = 2.5  # of the usual time between frames


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


@dataclass(frozen=True, slots=True)
class Windows:
    """One view's windows in order: when each begins and ends, its rate and its target."""

    start_ns: Integers
    end_ns: Integers
    sent_kbps: Floats
    target_kbps: Floats

    @property
    def error(self) -> Floats:
        """(sent − target)/target of each window."""
        return (self.sent_kbps - self.target_kbps) / self.target_kbps


def windows(tables: LogTables, view: str) -> Windows:
    """Every full window between the first and the last frame that was put on the wire.

    Windows are 8 consecutive frames, or as many as come nearest to 270 ms if that is more, sliding
    by one frame (docs/GLOSSARY.md, Measures). The rate of a window is the IP bytes of its frames'
    media and repair packets over the time from its first capture to the one after its last. A frame
    that was dropped at the source counts with no bytes. No window spans a gap in which the camera
    missed two frames or more in a row, or a time before or after the operator's side of two has
    been received.
    """
    frames, targets = tables.frames[view], tables.targets
    per_frame = wire_bytes(tables, view)
    on_wire = np.flatnonzero(per_frame)
    inside = slice(on_wire[0], on_wire[-1] + 1) if len(on_wire) else slice(0, 0)
    start_ns, usual_ns = frames.capture_ns[inside], frames.usual_ns[inside]
    end_ns = np.append(start_ns, start_ns[-1:] + usual_ns[-1:])[1:]
    target = last_before(targets.t_ns, targets.kbps[view], start_ns)  # NaN before the first
    first = np.arange(len(start_ns))
    enough = np.searchsorted(end_ns, start_ns + WINDOW_NS - usual_ns // 2)
    last = np.maximum(first + WINDOW_FRAMES - 1, enough)
    first, last = first[last < len(first)], last[last < len(first)]

    def total(values: Floats | Flags) -> Floats:
        cumulated = np.append(0.0, np.cumsum(values))
        found: Floats = cumulated[last + 1] - cumulated[first]
        return found

    durations_ns = end_ns - start_ns
    gap = durations_ns > GAP_INTERVALS * usual_ns
    left_out = total(np.isnan(target) | gap | _without_operator(tables.log, start_ns))
    time_ns = (end_ns[last] - start_ns[first]).astype(np.float64)
    window_target = total(np.nan_to_num(target) * durations_ns) / time_ns
    whole = (left_out == 0) & (window_target > 0)
    sent_kbps = total(per_frame[inside]) * 8 / 1000 / (time_ns / NS_PER_S)
    return Windows(
        start_ns[first][whole], end_ns[last][whole], sent_kbps[whole], window_target[whole]
    )


def _without_operator(log: SessionLog, start_ns: Integers) -> Flags:
    """Whether no operator was connected then; never on one computer."""
    received_ns = [one.t_ns for one in log.hands_received]
    if not received_ns:
        return np.zeros(len(start_ns), dtype=np.bool_)
    before: Flags = start_ns < min(received_ns)
    after: Flags = start_ns > max(received_ns)
    return before | after


def wire_bytes(tables: LogTables, view: str) -> Floats:
    """IP bytes of media and repair of each captured frame, shape (frames,)."""
    packets, index = tables.packets, tables.frames[view].index
    mine = packets.is_video & (packets.view == tables.places[view])
    frame = packets.frame[mine]
    place = np.searchsorted(index, frame)
    known = place < len(index)
    known[known] = index[place[known]] == frame[known]
    total: Floats = np.zeros(len(index))
    np.add.at(total, place[known], packets.size_bytes[mine][known])
    return total


def steps(targets: Targets, view: str) -> Integers:
    """The steps of `view`'s target by more than 10 %; the first target is a step, too."""
    kbps = targets.kbps[view]
    changed = np.abs(np.diff(kbps)) > STEP_FRACTION * kbps[:-1]
    return targets.t_ns[np.append(True, changed)] if len(kbps) else targets.t_ns


def tracking_error(found: Windows, step_ns: Integers) -> Number:
    """Mean |sent − target|/target of the windows that no recent step touches."""
    touched: Flags = np.zeros(len(found.start_ns), dtype=np.bool_)
    for at_ns in step_ns:
        touched |= (found.end_ns > at_ns) & (found.start_ns < at_ns + LEFT_OUT_NS)
    return mean(np.abs(found.error[~touched]))
