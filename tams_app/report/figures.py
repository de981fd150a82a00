"""Figures of a session, drawn for print: bitrates.png, the paper's bitrate tracking figure."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tams_app.outputs import new_file
from tams_app.palette import view_colour
from tams_app.recording import SessionLog
from tams_app.summary.tables import Floats, FrameTable, PacketTable, Span, Targets
from tams_app.units import NS_PER_MS, NS_PER_S

WINDOW_NS = 250 * NS_PER_MS
WINDOW_FRAMES = 7.5  # at least
STEPS_PER_FRAME = 4  # how far the window slides at a time
DPI = 200
WIDTH_IN = 7.16  # two columns of the paper
ROW_IN = 1.15

_TARGET = "#000000"
_PHASE_LINE = "#777777"
_FRAMES = "#555555"
_MIN_LABEL_FRACTION = 0.035  # of the width: phases shorter than this keep their line only
_STYLE_PT = 8
_TARGET_PT, _MEASURED_PT = 0.9, 1.3


@dataclass(frozen=True, slots=True)
class RateCurve:
    """A rate [kbit/s] at the end of each window, times in seconds since the session started."""

    t_s: Floats
    kbps: Floats


def measured_rate(
    packets: PacketTable, view: int, span: Span, frame_ns: int, origin_ns: int
) -> RateCurve:
    """IP bytes of media and repair that entered the uplink within trailing windows.

    Averaged over one frame time, `frame_ns`: frames enter in bursts, and a window holds 7 or 8 of
    them, which would draw a saw of 13 % that is not there.
    """
    window_ns = window_of_ns(frame_ns)
    mine = packets.is_video & (packets.view == view)
    order = np.argsort(packets.entered_ns[mine], kind="stable")
    entered_ns = packets.entered_ns[mine][order]
    total = np.concatenate(([0], np.cumsum(packets.size_bytes[mine][order])))
    step_ns = frame_ns / STEPS_PER_FRAME
    ends_ns = np.arange(span.start_ns + window_ns, span.end_ns + 1, step_ns)
    if len(ends_ns) < STEPS_PER_FRAME:
        return RateCurve(np.empty(0), np.empty(0))
    until = np.searchsorted(entered_ns, ends_ns, side="right")
    since = np.searchsorted(entered_ns, ends_ns - window_ns, side="right")
    kbps = (total[until] - total[since]) * 8 / 1000 / (window_ns / NS_PER_S)
    smooth = np.convolve(kbps, np.full(STEPS_PER_FRAME, 1 / STEPS_PER_FRAME), mode="valid")
    return RateCurve((ends_ns[STEPS_PER_FRAME - 1 :] - origin_ns) / NS_PER_S, smooth)


def window_of_ns(frame_ns: int) -> int:
    """250 ms, or longer where frames are rare."""
    return max(WINDOW_NS, round(WINDOW_FRAMES * frame_ns))


def frame_interval_ns(log: SessionLog, view: str) -> int:
    """The median time between captures."""
    usual_ns = FrameTable.of(log, view).usual_ns
    return int(np.median(usual_ns)) if len(usual_ns) else NS_PER_S // log.header.fps


def bitrates_figure(log: SessionLog) -> Figure:
    """Target and measured rate of each view over time, its frames a second dotted.

    Phases are dashed lines with their names.

    Also drawn for a log without any video, so that every session leaves the same files.
    """
    packets, targets, span = PacketTable.of(log), Targets.of(log), Span.of(log)
    views = log.header.views
    figure = Figure(figsize=(WIDTH_IN, ROW_IN * len(views) + 0.75), layout="constrained")
    FigureCanvasAgg(figure)
    axes = figure.subplots(len(views), 1, sharex=True, squeeze=False)[:, 0]
    for place, (view, axis) in enumerate(zip(views, axes, strict=True)):
        if span is not None:
            _draw_view(axis, log, place, packets, targets, span)
        _dress(axis, view)
    _draw_phases(log, list(axes), span)
    axes[-1].set_xlabel("Time since session start [s]", fontsize=_STYLE_PT)
    longest_ns = max(window_of_ns(frame_interval_ns(log, view)) for view in views)
    measured = f"Measured, {longest_ns // NS_PER_MS} ms windows"
    figure.legend(
        handles=[
            Line2D([], [], color=_TARGET, linewidth=_TARGET_PT, label="Target"),
            Line2D([], [], color=view_colour(0), linewidth=_MEASURED_PT, label=measured),
            Line2D([], [], color=_FRAMES, linewidth=_TARGET_PT, linestyle=":", label="Frames/s"),
        ],
        loc="outside upper right",
        ncols=3,
        fontsize=_STYLE_PT,
        frameon=False,
    )
    figure.suptitle(
        f"{log.header.strategy} on {log.header.network}, {log.header.budget_mode} budget",
        x=0.01,
        ha="left",
        fontsize=_STYLE_PT,
    )
    return figure


def save_bitrates(log: SessionLog, path: Path) -> None:
    """Write bitrates.png."""
    with new_file(path) as file:
        bitrates_figure(log).savefig(file, dpi=DPI, format="png")


def _draw_view(
    axis: Axes, log: SessionLog, place: int, packets: PacketTable, targets: Targets, span: Span
) -> None:
    origin_ns = log.header.started_ns
    view = log.header.views[place]
    kbps, frame_ns = targets.kbps[view], frame_interval_ns(log, view)
    axis.step(
        (np.append(targets.t_ns, span.end_ns) - origin_ns) / NS_PER_S,
        np.append(kbps, kbps[-1]) / 1000,
        where="post",
        color=_TARGET,
        linewidth=_TARGET_PT,
        zorder=3,
    )
    if len(packets.size_bytes):
        curve = measured_rate(packets, place, span, frame_ns, origin_ns)
        axis.plot(
            curve.t_s,
            curve.kbps / 1000,
            color=view_colour(place),
            linewidth=_MEASURED_PT,
        )
    _draw_frames(axis, log, view, span)


def _draw_frames(axis: Axes, log: SessionLog, view: str, span: Span) -> None:
    """Frames in each trailing second, on a scale of their own up to what was asked for."""
    capture_ns = FrameTable.of(log, view).capture_ns
    ends_ns = np.arange(span.start_ns + NS_PER_S, span.end_ns + 1, NS_PER_S // 4)
    frames = np.searchsorted(capture_ns, ends_ns) - np.searchsorted(capture_ns, ends_ns - NS_PER_S)
    t_s = (ends_ns - log.header.started_ns) / NS_PER_S
    right = axis.twinx()
    right.plot(t_s, frames, color=_FRAMES, linewidth=_TARGET_PT, linestyle=":")
    right.set_ylim(0, 1.05 * log.header.fps)
    right.set_yticks([0, log.header.fps])
    right.set_ylabel("frames/s", fontsize=_STYLE_PT - 1, color=_FRAMES)
    right.tick_params(labelsize=_STYLE_PT - 1, colors=_FRAMES)
    right.spines[["top", "left"]].set_visible(False)


def _dress(axis: Axes, view: str) -> None:
    axis.set_ylabel(f"{view.upper()}\n[Mbit/s]", fontsize=_STYLE_PT)
    axis.set_ylim(bottom=0)
    axis.margins(x=0)
    axis.tick_params(labelsize=_STYLE_PT - 1)
    axis.grid(axis="y", linewidth=0.3, color="#cccccc")
    axis.spines[["top", "right"]].set_visible(False)


def _draw_phases(log: SessionLog, axes: list[Axes], span: Span | None) -> None:
    """A dashed line where each phase begins, its name on top where it fits."""
    if span is None:
        return
    start_s, end_s = ((t - log.header.started_ns) / NS_PER_S for t in (span.start_ns, span.end_ns))
    axes[0].set_xlim(start_s, end_s)
    begins_s = [(change.t_ns - log.header.started_ns) / NS_PER_S for change in log.phases]
    for change, begin_s, next_s in zip(log.phases, begins_s, [*begins_s[1:], end_s], strict=True):
        visible_s = max(begin_s, start_s)
        if next_s <= start_s or begin_s >= end_s:
            continue
        for axis in axes:
            axis.axvline(visible_s, color=_PHASE_LINE, linestyle="--", linewidth=0.7, zorder=1)
        if next_s - visible_s >= _MIN_LABEL_FRACTION * (end_s - start_s):
            axes[0].annotate(
                change.phase.value.replace("_", "-"),
                (visible_s, 1.0),
                xycoords=("data", "axes fraction"),
                xytext=(2, 1),
                textcoords="offset points",
                fontsize=_STYLE_PT - 2.5,
                rotation=20,
                va="bottom",
            )
