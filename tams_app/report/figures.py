"""A session's figures over its time.

bitrates.png is the paper's figure of bitrate tracking; the timeline has on one axis phases, rates,
delay, quality, and what stopped the arm.
"""

from __future__ import annotations

from dataclasses import dataclass
from operator import attrgetter

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from tams_app.palette import (
    CAPACITY_ESTIMATE,
    EMULATED_CAPACITY,
    UPLINK_BUDGET,
    UPLINK_SENT,
    view_colour,
)
from tams_app.recording import SessionLog
from tams_app.records import StopRecord
from tams_app.report import plots
from tams_app.summary.tables import Floats, Integers, LogTables, PacketTable, Span, Targets
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_MS, NS_PER_S

WINDOW_NS = 250 * NS_PER_MS
WINDOW_FRAMES = 7.5  # at least
STEPS_PER_FRAME = 4  # how far the window slides at a time
_ROW_IN = 1.15
_MIN_LABEL_FRACTION = 0.035  # of the width: phases shorter than this keep their line only
_TARGET_PT, _MEASURED_PT = 0.9, 1.3
_TIMELINE_ROW_IN, _BAND_IN = 1.25, 0.55
_HELD: dict[str, tuple[str, str]] = {  # the word, and the strokes behind the curves
    ArmingState.HOLDING: ("hold", "//"),
    ArmingState.FAULT: ("fault", "xx"),
}
_QUALITY_WINDOW_S = 1.0


def all_since_start_s(log: SessionLog, t_ns: Integers) -> Floats:
    """As `log.since_start_s`, of each."""
    seconds: Floats = (t_ns - log.header.started_ns) / NS_PER_S
    return seconds


def phase_stretches(log: SessionLog) -> list[plots.NamedStretch]:
    """Each phase with its end, in order."""
    times_s = [log.since_start_s(t_ns) for t_ns in (*(c.t_ns for c in log.phases), log.ended_ns)]
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
    figure = plots.new_figure(plots.PAPER_IN, _ROW_IN * len(views) + 0.75)
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
    start_s, end_s = (log.since_start_s(t_ns) for t_ns in (span.start_ns, span.end_ns))
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


def held_stretches(log: SessionLog) -> list[plots.NamedStretch]:
    """While the arm was held or stopped by a fault, with the word for it."""
    found: list[plots.NamedStretch] = []
    state, since_ns = "", 0
    for arming, t_ns in (*((one.arming, one.started_ns) for one in log.ticks), ("", log.ended_ns)):
        if arming != state:
            if state in _HELD:
                ends_s = (log.since_start_s(end_ns) for end_ns in (since_ns, t_ns))
                found.append(plots.NamedStretch(_HELD[state][0], *ends_s))
            state, since_ns = arming, t_ns
    return found


def stops_of(log: SessionLog) -> list[tuple[float, StopRecord]]:
    """Each stop with its time in seconds since the start, in the order of their numbers."""
    ordered = sorted(log.stops, key=attrgetter("visible_ns"))
    return [(log.since_start_s(stop.visible_ns), stop) for stop in ordered]


@plots.styled
def timeline_figure(tables: LogTables) -> Figure:
    """All of a session; also drawn for a log without any video."""
    log = tables.log
    views, ended_s = log.header.views, log.since_start_s(log.ended_ns)
    heights = [_BAND_IN, *([_TIMELINE_ROW_IN] * (len(views) + 3))]
    figure = plots.new_figure(plots.WIDE_IN, sum(heights) + 0.6)
    rows = figure.subplots(
        len(heights), 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": heights}
    )[:, 0]
    band, *of_views, link, delay, quality = rows
    plots.draw_phase_strip(band, phase_stretches(log), ended_s)
    rates = SentRates.of(tables)
    for place, (view, axis) in enumerate(zip(views, of_views, strict=True)):
        dress_rate(axis, view.upper())
        if rates is not None:
            rates.draw(axis, place, view)
        _draw_delay(delay, tables, place, view)
        _draw_quality(quality, log, place, view)
    most = max(0.001, *(axis.dataLim.y1 for axis in of_views))
    for axis in of_views:  # one scale, so that the views can be compared
        axis.set_ylim(0, 1.08 * most)
    if rates is not None:
        _draw_uplink(link, log, rates)
    dress_rate(link, "Uplink")
    for axis, label in ((delay, "Capture to\nscreen [ms]"), (quality, "SSIM live")):
        axis.set_ylabel(label)
        axis.grid(axis="y")
    delay.set_ylim(bottom=0)
    quality.set_ylim(top=1.0)
    for axis in rows[1:]:
        _draw_stops(axis, log)
    for axis in (of_views[0], link, delay, quality):
        if axis.get_legend_handles_labels()[0]:
            ground: plots.Style = {"frameon": True, "facecolor": plots.GROUND, "edgecolor": "none"}
            # the few points of quality: none is hidden
            where = "best" if axis is quality else "lower right"
            axis.legend(loc=where, ncols=4, fontsize=plots.TINY_PT, framealpha=0.85, **ground)
    rows[-1].set_xlabel(plots.TIME_AXIS)
    rows[-1].set_xlim(0.0, max(ended_s, 0.1))
    return figure


def _draw_uplink(link: Axes, log: SessionLog, rates: SentRates) -> None:
    """Rate, budget and capacities of the uplink."""
    if curves := list(rates.curves.values()):  # at the times of the first
        t_s = curves[0].t_s
        sent = sum(np.interp(t_s, curve.t_s, curve.kbps) for curve in curves) / 1000
        link.plot(t_s, sent, color=UPLINK_SENT, lw=2.2, label="sent, all views")
    step: plots.Style = {"where": "post", "lw": 1}
    targets = rates.targets
    budget_kbps, estimate_kbps = (
        np.append(kbps, kbps[-1]) for kbps in (targets.budget_kbps, targets.capacity_kbps)
    )
    link.step(rates.t_s, budget_kbps / 1000, color=UPLINK_BUDGET, label="budget", **step)
    dashed: plots.Style = {**step, "ls": "--", "color": CAPACITY_ESTIMATE}
    link.step(rates.t_s, estimate_kbps / 1000, label="capacity estimate", **dashed)
    if emulated := [one for one in log.capacities if one.capacity_kbps is not None]:
        ends = np.array([*(one.t_ns for one in emulated), rates.span.end_ns])
        kbps = np.array([one.capacity_kbps for one in (*emulated, emulated[-1])], dtype=float)
        dotted: plots.Style = {**step, "ls": ":", "color": EMULATED_CAPACITY}
        link.step(all_since_start_s(log, ends), kbps / 1000, label="emulated capacity", **dotted)


def _draw_delay(axis: Axes, tables: LogTables, place: int, view: str) -> None:
    frames = tables.frames[view]
    shown = frames.shown_ns > 0
    t_s = all_since_start_s(tables.log, frames.shown_ns[shown])
    delay_ms = (frames.shown_ns[shown] - frames.capture_ns[shown]) / NS_PER_MS
    curve = _broken(t_s, delay_ms)
    axis.plot(*curve, color=view_colour(place), lw=1, label=view.upper())


def _draw_quality(axis: Axes, log: SessionLog, place: int, view: str) -> None:
    """Means of a second of what was on the screen."""
    scored = [(one.capture_ns, one.live) for one in log.quality if one.view == view and one.live]
    if not scored:
        return
    t_s = all_since_start_s(log, np.array([t_ns for t_ns, _ in scored], dtype=np.int64))
    seconds = np.floor(t_s / _QUALITY_WINDOW_S)
    values = np.array([value for _, value in scored])
    ends = np.unique(seconds)
    means = np.array([values[seconds == end].mean() for end in ends])
    curve = _broken((ends + 0.5) * _QUALITY_WINDOW_S, means, _QUALITY_WINDOW_S)
    axis.plot(*curve, ".-", ms=3, color=view_colour(place), label=view.upper())


def _broken(t_s: Floats, values: Floats, longest_s: float = 1.0) -> tuple[Floats, Floats]:
    """The points of a curve, with a break where none follows within `longest_s`."""
    gaps = np.flatnonzero(np.diff(t_s) > longest_s) + 1
    return np.insert(t_s, gaps, np.nan), np.insert(values, gaps, np.nan)


def _draw_stops(axis: Axes, log: SessionLog) -> None:
    """Holds and faults hatched, each stop a numbered line."""
    for held in held_stretches(log):
        strokes: plots.Style = {
            "facecolor": "none",
            "edgecolor": plots.HATCH,
            "hatch": dict(_HELD.values())[held.name],
        }
        axis.axvspan(held.start_s, held.end_s, linewidth=0, zorder=0, **strokes)
    line: plots.Style = {"color": plots.STOP, "lw": 1.2}
    for number, (t_s, _) in enumerate(stops_of(log), start=1):
        plots.draw_event(
            axis, t_s, str(number), line, {"color": plots.STOP, "fontsize": plots.SMALL_PT}
        )
