"""A whole session on one time axis: phases, rates, delay, quality, and what stopped the arm."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, TypeAlias

import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
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
from tams_app.report.figures import RateCurve, frame_interval_ns, measured_rate
from tams_app.summary.tables import Floats, FrameTable, PacketTable, Span, Targets
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_MS, NS_PER_S

WIDTH_IN, ROW_IN, BAND_IN = 11.0, 1.25, 0.55
_TEXT_PT = 9
_STOP = "#B00020"
_PHASE_COLOURS = ("#e8e8e8", "#cfcfcf")  # in turn; the names tell them apart
_LAST = 0.94  # part of the session
_NAME_LEVELS = 3  # names of short phases stand on other levels, so that none hides another
_HELD: dict[str, tuple[str, str]] = {  # the word, and the strokes behind the curves
    ArmingState.HOLDING: ("hold", "//"),
    ArmingState.FAULT: ("fault", "xx"),
}
_QUALITY_WINDOW_S = 1.0

Style: TypeAlias = dict[str, Any]  # keyword arguments of matplotlib


@dataclass(frozen=True, slots=True)
class Stretch:
    """A part of the session, in seconds since its start."""

    name: str
    start_s: float
    end_s: float


def phase_stretches(log: SessionLog) -> list[Stretch]:
    """Each phase with its end, in order."""
    ends = [change.t_ns for change in log.phases[1:]] + [log.ended_ns]
    return [
        Stretch(change.phase.value.replace("_", "-").title(), _s(log, change.t_ns), _s(log, end_ns))
        for change, end_ns in zip(log.phases, ends, strict=False)
    ]


def held_stretches(log: SessionLog) -> list[Stretch]:
    """While the arm was held or stopped by a fault, with the word for it."""
    found: list[Stretch] = []
    state, since_ns = "", 0
    for arming, t_ns in (*((one.arming, one.started_ns) for one in log.ticks), ("", log.ended_ns)):
        if arming != state:
            if state in _HELD:
                found.append(Stretch(_HELD[state][0], _s(log, since_ns), _s(log, t_ns)))
            state, since_ns = arming, t_ns
    return found


def stops_of(log: SessionLog) -> list[tuple[float, StopRecord]]:
    """Each stop with its time in seconds since the start, in the order of their numbers."""
    return [(_s(log, stop.visible_ns), stop) for stop in sorted(log.stops, key=_visible_ns)]


def timeline_figure(log: SessionLog) -> Figure:
    """All of a session; also drawn for a log without any video."""
    views = log.header.views
    heights = [BAND_IN, *([ROW_IN] * (len(views) + 3))]
    figure = Figure(figsize=(WIDTH_IN, sum(heights) + 0.6), layout="constrained")
    FigureCanvasAgg(figure)
    rows = figure.subplots(
        len(heights), 1, sharex=True, squeeze=False, gridspec_kw={"height_ratios": heights}
    )[:, 0]
    band, *rates, link, delay, quality = rows
    span = Span.of(log)
    _draw_phases(band, log)
    most_kbps = _draw_rates(rates, link, log, span)
    for axis in rates:  # one scale, so that the views can be compared
        axis.set_ylim(0, 1.08 * max(most_kbps, 1.0) / 1000)
    for place, view in enumerate(views):
        _draw_delay(delay, log, place, view)
        _draw_quality(quality, log, place, view)
    for axis, label in (
        *((axis, f"{view.upper()}\nMbit/s") for view, axis in zip(views, rates, strict=True)),
        (link, "Uplink\nMbit/s"),
        (delay, "Capture to\nscreen, ms"),
        (quality, "SSIM live"),
    ):
        _dress(axis, label)
    delay.set_ylim(bottom=0)
    quality.set_ylim(top=1.0)
    for axis in rows[1:]:
        _draw_stops(axis, log)
    for axis in (rates[0], link, delay, quality):
        if axis.get_legend_handles_labels()[0]:
            axis.legend(
                loc="lower right",
                ncols=4,
                fontsize=_TEXT_PT - 2,
                framealpha=0.85,
                edgecolor="none",
                borderaxespad=0.2,
            )
    rows[-1].set_xlabel("Time since session start, s", fontsize=_TEXT_PT)
    rows[-1].set_xlim(0.0, max(_s(log, log.ended_ns), 0.1))
    return figure


def _draw_phases(axis: Axes, log: SessionLog) -> None:
    """Bands, every one with its name; names of short ones are on other levels."""
    axis.set_ylim(0, 1)
    axis.set_yticks([])
    axis.spines[:].set_visible(False)
    whole_s = _s(log, log.ended_ns)
    for number, phase in enumerate(phase_stretches(log)):
        axis.axvspan(phase.start_s, phase.end_s, color=_PHASE_COLOURS[number % 2], linewidth=0)
        is_last = phase.start_s > _LAST * whole_s  # there its name ends where the figure does
        axis.text(
            whole_s if is_last else phase.start_s,
            0.97 - number % _NAME_LEVELS / _NAME_LEVELS,
            phase.name,
            fontsize=_TEXT_PT - 2,
            va="top",
            ha="right" if is_last else "left",
        )


def _draw_rates(rates: Sequence[Axes], link: Axes, log: SessionLog, span: Span | None) -> float:
    """Target and measured rate of each view and of the uplink; the most of a view [kbit/s]."""
    if span is None:
        return 0.0
    packets, targets = PacketTable.of(log), Targets.of(log)
    t_s = _seconds(log, np.append(targets.t_ns, span.end_ns))
    most_kbps, total = 0.0, None
    for place, (view, axis) in enumerate(zip(log.header.views, rates, strict=True)):
        kbps = targets.kbps[view]
        axis.step(
            t_s, np.append(kbps, kbps[-1]) / 1000, where="post", color="black", lw=1, label="target"
        )
        curve = measured_rate(
            packets, place, span, frame_interval_ns(log, view), log.header.started_ns
        )
        if len(curve.t_s):
            axis.plot(curve.t_s, curve.kbps / 1000, color=view_colour(place), lw=1.4, label="sent")
        most_kbps = max(most_kbps, float(kbps.max()), float(curve.kbps.max(initial=0.0)))
        total = _sum(total, curve)
    if total is not None:
        link.plot(total.t_s, total.kbps / 1000, color=UPLINK_SENT, lw=2.2, label="sent, all views")
    budget_kbps = np.append(targets.budget_kbps, targets.budget_kbps[-1])
    step: Style = {"where": "post", "lw": 1}
    link.step(t_s, budget_kbps / 1000, color=UPLINK_BUDGET, label="budget", **step)
    believed = [one.capacity_kbps for one in sorted(log.allocations, key=lambda one: one.t_ns)]
    estimate = np.array([np.nan if kbps is None else kbps for kbps in (*believed, believed[-1])])
    link.step(
        t_s, estimate / 1000, color=CAPACITY_ESTIMATE, ls="--", label="capacity estimate", **step
    )
    if emulated := [one for one in log.capacities if one.capacity_kbps is not None]:
        ends_s = _seconds(log, np.array([*(one.t_ns for one in emulated), span.end_ns]))
        kbps = np.array([one.capacity_kbps for one in (*emulated, emulated[-1])], dtype=float)
        link.step(
            ends_s, kbps / 1000, color=EMULATED_CAPACITY, ls=":", label="emulated capacity", **step
        )
    link.set_ylim(bottom=0)
    return most_kbps


def _sum(total: RateCurve | None, curve: RateCurve) -> RateCurve | None:
    """Rates at the times of the first curve."""
    if not len(curve.t_s):
        return total
    if total is None:
        return curve
    return RateCurve(total.t_s, total.kbps + np.interp(total.t_s, curve.t_s, curve.kbps))


def _draw_delay(axis: Axes, log: SessionLog, place: int, view: str) -> None:
    frames = FrameTable.of(log, view)
    shown = frames.shown_ns > 0
    axis.plot(
        _seconds(log, frames.shown_ns[shown]),
        (frames.shown_ns[shown] - frames.capture_ns[shown]) / NS_PER_MS,
        color=view_colour(place),
        lw=1,
        label=view.upper(),
    )


def _draw_quality(axis: Axes, log: SessionLog, place: int, view: str) -> None:
    """Means of a second of what was on the screen."""
    scored = [(one.capture_ns, one.live) for one in log.quality if one.view == view and one.live]
    if not scored:
        return
    t_s = _seconds(log, np.array([t_ns for t_ns, _ in scored], dtype=np.int64))
    seconds = np.floor(t_s / _QUALITY_WINDOW_S)
    values = np.array([value for _, value in scored])
    ends = np.unique(seconds)
    means = [float(values[seconds == end].mean()) for end in ends]
    axis.plot((ends + 0.5) * _QUALITY_WINDOW_S, means, color=view_colour(place), label=view.upper())


def _draw_stops(axis: Axes, log: SessionLog) -> None:
    """Holds and faults hatched, each stop a numbered line."""
    hatches = dict(_HELD.values())
    for held in held_stretches(log):
        axis.axvspan(
            held.start_s,
            held.end_s,
            facecolor="none",
            edgecolor="#bbbbbb",
            hatch=hatches[held.name],
            linewidth=0,
            zorder=0,
        )
    for number, (t_s, _) in enumerate(stops_of(log), start=1):
        axis.axvline(t_s, color=_STOP, lw=1.2)
        axis.annotate(
            str(number),
            (t_s, 1.0),
            xycoords=("data", "axes fraction"),
            xytext=(2, -2),
            textcoords="offset points",
            color=_STOP,
            fontsize=_TEXT_PT - 1,
            va="top",
        )


def _dress(axis: Axes, label: str) -> None:
    axis.set_ylabel(label, fontsize=_TEXT_PT)
    axis.tick_params(labelsize=_TEXT_PT - 1)
    axis.grid(axis="y", linewidth=0.3, color="#cccccc")
    axis.spines[["top", "right"]].set_visible(False)


def _visible_ns(stop: StopRecord) -> int:
    return stop.visible_ns


def _s(log: SessionLog, t_ns: int) -> float:
    return (t_ns - log.header.started_ns) / NS_PER_S


def _seconds(log: SessionLog, t_ns: np.ndarray) -> Floats:
    seconds: Floats = (t_ns - log.header.started_ns) / NS_PER_S
    return seconds
