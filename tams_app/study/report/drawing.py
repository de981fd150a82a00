"""The figures of a report: colours safe for colour-blind readers, markers besides."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator

from tams_app import palette
from tams_app.records import Phase
from tams_app.report import plots
from tams_app.report.pages import Estimate, name, phase_name
from tams_app.study.report import paper
from tams_app.study.report.measures import Measures, Quantity
from tams_app.study.results import PHASES

# of strategies
COLOURS = (
    "#999999",
    *(palette.ORANGE, palette.BLUE, palette.GREEN, palette.PURPLE, palette.SKY, palette.VERMILLION),
)
MARKERS = ("s", "^", "o", "D", "v", "P", "X")
HATCHES = ("", "//", "..", "xx", "\\\\", "++", "oo")
_TICKS = 4  # more would run into each other
_JITTER_SEED = 5


@plots.styled
def ssim_figure(measures: Measures) -> Figure:
    """Received SSIM of the primary view beside the paper's."""
    figure, (axis,) = _new_figure(2.8)
    for place, strategy, column, network, x in _side_by_side(measures, 0.5):
        label = name(strategy) if column == 0 else None
        found = measures.mean(strategy, network, "primary_received_ssim")
        _draw_estimate(axis, x, found, label=label, **_look(place))
        theirs = paper.RECEIVED_SSIM.get((strategy, network))
        if theirs is not None:
            _draw_theirs(axis, x + 0.06, theirs, MARKERS[place % len(MARKERS)], "none", 6)
    _name_networks(axis, measures)
    axis.set_ylabel("Received SSIM, primary view")
    plots.legend_beside(figure, axis)
    return figure


@plots.styled
def ssim_phases_figure(measures: Measures) -> Figure:
    """Received SSIM of the primary view by phase, a panel for each network."""
    plan = measures.data.plan
    figure, axes = _new_figure(3.4, len(plan.networks), share_y=False)
    shifts = _offsets(len(plan.strategies), 0.6)
    for axis, network in zip(axes, plan.networks, strict=True):
        for place, strategy in enumerate(plan.strategies):
            for column, phase in enumerate(PHASES):
                found = measures.mean(strategy, network, "received_ssim", phase)
                label = name(strategy) if column == 0 else None
                _draw_estimate(axis, column + shifts[place], found, label=label, **_look(place))
        _name_phases(axis, rotation=35, ha="right", fontsize=plots.SMALL_PT)
        axis.set_title(name(network))
    axes[0].set_ylabel("Received SSIM, primary view")
    plots.legend_beside(figure, axes[0])
    return figure


@plots.styled
def differences_figure(
    measures: Measures, quantities: Sequence[Quantity], one_scale: bool = False
) -> Figure:
    """A panel for each quantity: the proposed strategy minus each other one, by network.

    `one_scale`: for parts of a sum, which are compared by eye.
    """
    plan, others = measures.data.plan, measures.others
    figure, axes = _new_figure(
        1.1 + 0.42 * len(plan.networks) * max(1, len(others)), len(quantities)
    )
    for axis, quantity in zip(axes, quantities, strict=True):
        axis.grid(visible=False)
        axis.grid(axis="x")
        axis.axvline(0, color=plots.INK, linewidth=1)
        for other, shift in zip(others, _offsets(len(others), 0.5), strict=True):
            place = plan.strategies.index(other)
            for row, network in enumerate(plan.networks):
                found = measures.difference(other, network, quantity.column).estimate
                label = f"against {name(other)}" if row == 0 else None
                look = _look(place)
                _draw_estimate(axis, row + shift, found, across=True, label=label, **look)
        axis.set_title(quantity.title)
        axis.set_xlabel(quantity.better, fontsize=plots.SMALL_PT)
        axis.set_ylim(len(plan.networks) - 0.5, -0.5)
        axis.set_yticks(range(len(plan.networks)), [name(one) for one in plan.networks])
        axis.xaxis.set_major_locator(MaxNLocator(_TICKS))
    if one_scale:
        drawn = [axis for axis in axes if axis.containers] or axes
        ends = [end for axis in drawn for end in axis.get_xlim()]
        for axis in axes:
            axis.set_xlim(min(ends), max(ends))
    plots.legend_beside(figure, axes[0])
    return figure


@plots.styled
def completion_time_figure(measures: Measures) -> Figure:
    """The paper's box plot: quartiles, median, whiskers 5th to 95th percentile, a dot per trial."""
    figure, (axis,) = _new_figure(3.6)
    plan = measures.data.plan
    width = 0.8 / len(plan.strategies) * 0.75
    random = np.random.default_rng(_JITTER_SEED)
    top = 0.0
    for place, strategy, _, network, x in _side_by_side(measures, 0.8):
        times = measures.values(strategy, network, "completion_time_s")
        if times:
            _draw_box(axis, times, x, width, place, random)
            top = max(top, *times)
    axis.set_ylim(0, 1.05 * top)
    for place, strategy in enumerate(plan.strategies):
        axis.fill_between([], [], color=COLOURS[place % len(COLOURS)], label=name(strategy))
    _name_networks(axis, measures)
    axis.set_ylabel("Completion time [s]")
    plots.legend_beside(figure, axis)
    return figure


@plots.styled
def success_figure(measures: Measures) -> Figure:
    """Success rates with Wilson's intervals beside the paper's."""
    figure, (axis,) = _new_figure(3.0)
    count = len(measures.data.plan.strategies)
    for place, strategy, column, network, x in _side_by_side(measures, 0.78):
        fill = _fill(COLOURS[place % len(COLOURS)], place)
        if column == 0:
            axis.bar([0], [0], label=name(strategy), **fill)
        found = measures.share(strategy, network, "success")
        if found is None or found.low is None or found.high is None:
            continue
        low, value, high = (100 * one for one in (found.low, found.value, found.high))
        axis.bar(x, value, 0.78 / count * 0.9, linewidth=0.6, alpha=0.8, **fill)
        _draw_estimate(axis, x, Estimate(value, low, high, found.n), fmt="none")
        above: plots.Style = {"xytext": (0, 2), "textcoords": "offset points", "ha": "center"}
        axis.annotate(f"{value:.0f} %", (x, high), fontsize=plots.SMALL_PT, **above)
        theirs = paper.SUCCESS_SHARE.get((strategy, network))
        if theirs is not None:
            _draw_theirs(axis, x, 100 * theirs, "D", plots.GROUND, 5)
    axis.set_ylim(0, 112)
    axis.set_yticks(range(0, 101, 20))
    _name_networks(axis, measures)
    axis.set_ylabel("Success [%]")
    plots.legend_beside(figure, axis)
    return figure


@plots.styled
def relied_on_figure(measures: Measures) -> Figure:
    """Each view's share of what the operator's glances show, beside the rows of W."""
    figure, (axis,) = _new_figure(3.0)
    weights = measures.weights
    for column, phase in enumerate(PHASES):
        below_reported = below_weight = 0.0
        for place, view in enumerate(measures.data.config.video.views):
            fill = _fill(palette.view_colour(place), place)
            found = measures.relied_on(phase, view)
            reported, weight = found.value if found else 0.0, weights.row(Phase(phase))[view]
            label = view.upper() if column == 0 else None
            bar: plots.Style = {"width": 0.34, "linewidth": 0.6, **fill}
            axis.bar(column - 0.2, reported, bottom=below_reported, alpha=0.9, label=label, **bar)
            axis.bar(column + 0.2, weight, bottom=below_weight, alpha=0.45, **bar)
            below_reported, below_weight = below_reported + reported, below_weight + weight
    _name_phases(axis, fontsize=plots.TEXT_PT)
    axis.set_ylabel("Share")
    axis.set_ylim(0, 1.02)
    plots.legend_beside(figure, axis)
    return figure


def _new_figure(
    height_in: float, columns: int = 1, share_y: bool = True
) -> tuple[Figure, list[Axes]]:
    """A figure with one row of axes and a grid."""
    figure = plots.new_figure(plots.PAGE_IN, height_in)
    axes = list(figure.subplots(1, columns, squeeze=False, sharey=share_y)[0])
    for axis in axes:
        axis.grid(axis="y")
    return figure, axes


def _offsets(count: int, width: float) -> list[float]:
    """Where `count` things stand side by side around a tick."""
    step = width / count
    return [(place - (count - 1) / 2) * step for place in range(count)]


def _side_by_side(measures: Measures, width: float) -> Iterator[tuple[int, str, int, str, float]]:
    """Number and name of each strategy and network, and where they stand on the x axis."""
    plan = measures.data.plan
    for place, shift in enumerate(_offsets(len(plan.strategies), width)):
        for column, network in enumerate(plan.networks):
            yield place, plan.strategies[place], column, network, column + shift


def _name_networks(axis: Axes, measures: Measures) -> None:
    networks = measures.data.plan.networks
    axis.set_xlim(-0.5, len(networks) - 0.5)
    axis.set_xticks(range(len(networks)), [name(one) for one in networks], fontsize=plots.TEXT_PT)


def _name_phases(axis: Axes, **style: Any) -> None:
    axis.set_xticks(range(len(PHASES)), [phase_name(one) for one in PHASES], **style)


def _look(place: int) -> plots.Style:
    """Marker and colour of strategy number `place`."""
    return {"fmt": MARKERS[place % len(MARKERS)], "color": COLOURS[place % len(COLOURS)]}


def _fill(colour: str, place: int) -> plots.Style:
    """Colour and strokes of the bars of what is number `place`."""
    return {"color": colour, "hatch": HATCHES[place % len(HATCHES)], "edgecolor": plots.INK}


def _draw_theirs(
    axis: Axes, x: float, value: float, marker: str, ground: str, size_pt: float
) -> None:
    """A value of the paper's; the first one of a figure is named."""
    named = "paper, people" in axis.get_legend_handles_labels()[1]
    label = None if named else "paper, people"
    colours: plots.Style = {"markerfacecolor": ground, "markeredgecolor": plots.INK}
    axis.plot(x, value, marker, label=label, markersize=size_pt, **colours)


def _draw_estimate(
    axis: Axes, where: float, found: Estimate | None, across: bool = False, **mark: Any
) -> None:
    """A mark with its interval, upright at x or lying (`across`) at y; nothing if none is known."""
    if found is None:
        return
    value, low, high = found.value, found.low, found.high
    error = None if low is None or high is None else [[value - low], [high - value]]
    axis.errorbar(
        *((value, where) if across else (where, value)),
        xerr=error if across else None,
        yerr=None if across else error,
        **{"ecolor": plots.INK, "elinewidth": 0.9, "capsize": 2.5, "markeredgecolor": plots.INK,
           "markeredgewidth": 0.5, "markersize": 6, **mark},
    )  # fmt: skip


def _draw_box(
    axis: Axes, times: list[float], x: float, width: float, place: int, random: np.random.Generator
) -> None:
    thin: plots.Style = {"color": plots.INK, "linewidth": 0.9}
    axis.boxplot(
        [times],
        positions=[x],
        widths=width,
        whis=(5, 95),
        showfliers=False,
        patch_artist=True,
        manage_ticks=False,
        boxprops={
            "facecolor": COLOURS[place % len(COLOURS)],
            "alpha": 0.55,
            "edgecolor": plots.INK,
        },
        medianprops={"color": plots.INK, "linewidth": 1.6},
        whiskerprops=thin,
        capprops=thin,
    )
    scattered = x + random.uniform(-0.35, 0.35, len(times)) * width
    axis.plot(scattered, times, ".", color=plots.INK, alpha=0.45, markersize=3.5)
