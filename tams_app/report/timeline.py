"""A whole session on one time axis: phases, rates, delay, quality, and what stopped the arm."""

from __future__ import annotations

from operator import attrgetter

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

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
from tams_app.report.figures import (
    SentRates,
    all_since_start_s,
    dress_rate,
    phase_stretches,
    since_start_s,
)
from tams_app.summary.tables import Floats, LogTables
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_MS

ROW_IN, BAND_IN = 1.25, 0.55
_HELD: dict[str, tuple[str, str]] = {  # the word, and the strokes behind the curves
    ArmingState.HOLDING: ("hold", "//"),
    ArmingState.FAULT: ("fault", "xx"),
}
_QUALITY_WINDOW_S = 1.0


def held_stretches(log: SessionLog) -> list[plots.NamedStretch]:
    """While the arm was held or stopped by a fault, with the word for it."""
    found: list[plots.NamedStretch] = []
    state, since_ns = "", 0
    for arming, t_ns in (*((one.arming, one.started_ns) for one in log.ticks), ("", log.ended_ns)):
        if arming != state:
            if state in _HELD:
                ends_s = (since_start_s(log, end_ns) for end_ns in (since_ns, t_ns))
                found.append(plots.NamedStretch(_HELD[state][0], *ends_s))
            state, since_ns = arming, t_ns
    return found


def stops_of(log: SessionLog) -> list[tuple[float, StopRecord]]:
    """Each stop with its time in seconds since the start, in the order of their numbers."""
    ordered = sorted(log.stops, key=attrgetter("visible_ns"))
    return [(since_start_s(log, stop.visible_ns), stop) for stop in ordered]


@plots.styled
def timeline_figure(tables: LogTables) -> Figure:
    """All of a session; also drawn for a log without any video."""
    log = tables.log
    views, ended_s = log.header.views, since_start_s(log, log.ended_ns)
    heights = [BAND_IN, *([ROW_IN] * (len(views) + 3))]
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
