"""Paired differences of several quantities, as a figure and a table with the same values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from matplotlib.ticker import MaxNLocator

from tams_app.study.report.blocks import Picture, Table
from tams_app.study.report.comparing import Measure, compare, others
from tams_app.study.report.drawing import (
    GRID,
    INK,
    SMALL_PT,
    TITLE_PT,
    draw_estimate,
    legend_above,
    new_figure,
    offsets,
    picture,
)
from tams_app.study.report.wording import interval, name
from tams_app.study.results import StudyData

_TICKS = 4  # more would run into each other


@dataclass(frozen=True, slots=True)
class Quantity:
    """What is compared; `better` says which way, on the axis."""

    title: str
    better: str
    measure: Measure
    digits: int


def paired_figure(
    data: StudyData,
    key: str,
    caption: str,
    quantities: Sequence[Quantity],
    one_scale: bool = False,
) -> Picture:
    """A panel for each quantity: the proposed strategy minus each other one, by network.

    `one_scale`: for parts of a sum, which are compared by eye.
    """
    networks = data.plan.networks
    height_in = 1.1 + 0.42 * len(networks) * max(1, len(others(data)))
    figure, axes = new_figure(height_in, len(quantities))
    for axis, quantity in zip(axes, quantities, strict=True):
        axis.grid(visible=False)
        axis.grid(axis="x", linewidth=0.5, color=GRID)
        axis.axvline(0, color=INK, linewidth=1)
        for other, shift in zip(others(data), offsets(len(others(data)), 0.5), strict=True):
            place = data.plan.strategies.index(other)
            for row, network in enumerate(networks):
                found = compare(data, other, network, quantity.measure).estimate
                label = f"against {name(other)}" if row == 0 else None
                draw_estimate(axis, row + shift, found, place, label, across=True)
        axis.set_title(quantity.title, fontsize=TITLE_PT)
        axis.set_xlabel(quantity.better, fontsize=SMALL_PT)
        axis.set_ylim(len(networks) - 0.5, -0.5)
        axis.set_yticks(range(len(networks)), [name(one) for one in networks])
        axis.tick_params(labelsize=SMALL_PT)
        axis.xaxis.set_major_locator(MaxNLocator(_TICKS))
    if one_scale:
        drawn = [axis for axis in axes if axis.containers] or axes
        ends = [end for axis in drawn for end in axis.get_xlim()]
        for axis in axes:
            axis.set_xlim(min(ends), max(ends))
    legend_above(figure, axes[0])
    return picture(figure, key, caption, "The values are those of the table below.")


def paired_table(data: StudyData, caption: str, quantities: Sequence[Quantity]) -> Table:
    """A row for each network and other strategy."""
    rows = tuple(
        (f"{name(network)}, against {name(other)}", *_cells(data, other, network, quantities))
        for network in data.plan.networks
        for other in others(data)
    )
    header = ("Comparison", *(quantity.title for quantity in quantities), "Pairs")
    return Table(caption, header, rows)


def _cells(
    data: StudyData, other: str, network: str, quantities: Sequence[Quantity]
) -> tuple[str, ...]:
    found = [compare(data, other, network, quantity.measure) for quantity in quantities]
    cells = [
        interval(one.estimate, quantity.digits, signed=True)
        for one, quantity in zip(found, quantities, strict=True)
    ]
    return (*cells, str(max(one.pairs for one in found)))
