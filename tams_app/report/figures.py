"""Rates over a session's time, and bitrates.png: the paper's bitrate tracking figure."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tams_app.palette import view_colour
from tams_app.recording import SessionLog
from tams_app.report import plots
from tams_app.summary.tables import Floats, Integers, LogTables, PacketTable, Span, Targets
from tams_app.units import NS_PER_MS, NS_PER_S

WINDOW_NS = 250 * NS_PER_MS
WINDOW_FRAMES = 7.5  # at least
STEPS_PER_FRAME = 4  # how far the window slides at a time
ROW_IN = 1.15
_MIN_LABEL_FRACTION = 0.035  # of the width: phases shorter than this keep their line only
_TARGET_PT, _MEASURED_PT = 0.9, 1.3


def since_start_s(log: SessionLog, t_ns: int) -> float:
    """A time of the session's clock in seconds since the session started."""
    return (t_ns - log.header.started_ns) / NS_PER_S


def all_since_start_s(log: SessionLog, t_ns: Integers) -> Floats:
    """As `since_start_s`, of each."""
    seconds: Floats = (t_ns - log.header.started_ns) / NS_PER_S
    return seconds


def phase_stretches(log: SessionLog) -> list[plots.NamedStretch]:
    """Each phase with its end, in order."""
    times_s = [since_start_s(log, t_ns) for t_ns in (*(c.t_ns for c in log.phases), log.ended_ns)]
    names = (change.phase.value.replace("_", "-").title() for change in log.phases)
    return [plots.NamedStretch(*one) for one in zip(names, times_s, times_s[1:], strict=False)]


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


def frame_interval_ns(tables: LogTables, view: str) -> int:
    """The median time between captures."""
    usual_ns = tables.frames[view].usual_ns
    return int(np.median(usual_ns)) if len(usual_ns) else NS_PER_S // tables.log.header.fps


@dataclass(frozen=True, slots=True)
class SentRates:
    """What was asked of each view and what was sent of it, while video was asked for."""

    span: Span
    targets: Targets
    t_s: Floats  # of the targets, and of the end
    curves: dict[str, RateCurve]  # of the views that packets are known of

    @staticmethod
    def of(tables: LogTables) -> SentRates | None:
        """None for a log without video."""
        log, packets, targets, span = tables.log, tables.packets, tables.targets, tables.span
        origin_ns = log.header.started_ns
        if span is None:
            return None
        found = {
            view: measured_rate(packets, place, span, frame_interval_ns(tables, view), origin_ns)
            for view, place in tables.places.items()
            if len(packets.size_bytes)
        }
        curves = {view: curve for view, curve in found.items() if len(curve.t_s)}
        t_s = all_since_start_s(log, np.append(targets.t_ns, span.end_ns))
        return SentRates(span, targets, t_s, curves)

    def draw(self, axis: Axes, place: int, view: str) -> None:
        """Target and measured rate of `view`, number `place` of all."""
        kbps = self.targets.kbps[view]
        target = np.append(kbps, kbps[-1]) / 1000
        axis.step(
            self.t_s, target, where="post", color=plots.INK, lw=_TARGET_PT, zorder=3, label="target"
        )
        if curve := self.curves.get(view):
            colour = view_colour(place)
            axis.plot(curve.t_s, curve.kbps / 1000, color=colour, lw=_MEASURED_PT, label="sent")


@plots.styled
def bitrates_figure(tables: LogTables) -> Figure:
    """Target and measured rate of each view over time, its frames a second dotted.

    Phases are dashed lines with their names. Also drawn for a log without any video.
    """
    log, rates = tables.log, SentRates.of(tables)
    views = log.header.views
    figure = plots.new_figure(plots.PAPER_IN, ROW_IN * len(views) + 0.75)
    axes = figure.subplots(len(views), 1, sharex=True, squeeze=False)[:, 0]
    for place, (view, axis) in enumerate(zip(views, axes, strict=True)):
        if rates is not None:
            rates.draw(axis, place, view)
            _draw_frames(axis, tables, view, rates.span)
        dress_rate(axis, view.upper())
        axis.margins(x=0)
    if rates is not None:
        _draw_phases(log, list(axes), rates.span)
    axes[-1].set_xlabel(plots.TIME_AXIS)
    longest_ns = max(window_of_ns(frame_interval_ns(tables, view)) for view in views)
    measured = f"Measured, {longest_ns // NS_PER_MS} ms windows"
    figure.legend(
        handles=[
            Line2D([], [], color=plots.INK, lw=_TARGET_PT, label="Target"),
            Line2D([], [], color=view_colour(0), lw=_MEASURED_PT, label=measured),
            Line2D([], [], color=plots.FAINT, lw=_TARGET_PT, linestyle=":", label="Frames/s"),
        ],
        loc="outside upper right",
        ncols=3,
    )
    title = f"{log.header.strategy} on {log.header.network}, {log.header.budget_mode} budget"
    figure.suptitle(title, x=0.01, ha="left", fontsize=plots.SMALL_PT)
    return figure


def dress_rate(axis: Axes, name: str) -> None:
    """The axis of a rate, from 0; `name`: of the view or of the uplink."""
    axis.set_ylabel(f"{name}\n[Mbit/s]")
    axis.set_ylim(bottom=0)
    axis.grid(axis="y")


def _draw_frames(axis: Axes, tables: LogTables, view: str, span: Span) -> None:
    """Frames in each trailing second, on a scale of their own up to what was asked for."""
    log, capture_ns = tables.log, tables.frames[view].capture_ns
    ends_ns = np.arange(span.start_ns + NS_PER_S, span.end_ns + 1, NS_PER_S // 4)
    frames = np.searchsorted(capture_ns, ends_ns) - np.searchsorted(capture_ns, ends_ns - NS_PER_S)
    right = axis.twinx()
    t_s = all_since_start_s(log, ends_ns)
    right.plot(t_s, frames, color=plots.FAINT, lw=_TARGET_PT, linestyle=":")
    right.set_ylim(0, 1.05 * log.header.fps)
    right.set_yticks([0, log.header.fps])
    right.set_ylabel("[frames/s]", fontsize=plots.TINY_PT, color=plots.FAINT)
    right.tick_params(labelsize=plots.TINY_PT, colors=plots.FAINT)
    right.spines["left"].set_visible(False)


def _draw_phases(log: SessionLog, axes: list[Axes], span: Span) -> None:
    """A dashed line where each phase begins, its name on top where it fits."""
    start_s, end_s = (since_start_s(log, t_ns) for t_ns in (span.start_ns, span.end_ns))
    axes[0].set_xlim(start_s, end_s)
    for phase, change in zip(phase_stretches(log), log.phases, strict=True):
        begin_s, until_s = max(phase.start_s, start_s), min(phase.end_s, end_s)
        if until_s <= start_s or begin_s >= end_s:
            continue
        fits = until_s - begin_s >= _MIN_LABEL_FRACTION * (end_s - start_s)
        for axis in axes:
            plots.draw_event(
                axis,
                begin_s,
                change.phase.value.replace("_", "-") if fits and axis is axes[0] else "",
                {"color": plots.FAINT, "linestyle": "--", "linewidth": 0.7, "zorder": 1},
                {"fontsize": plots.TINY_PT - 1.5, "rotation": 20, "xytext": (2, 1), "va": "bottom"},
            )
