"""Every paired difference with its interval, as one figure and one table."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from tams_app.study.report.blocks import Picture, Section, Table
from tams_app.study.report.comparing import Measure, compare, others
from tams_app.study.report.drawing import (
    COLOURS,
    GRID,
    INK,
    MARKERS,
    SMALL_PT,
    TITLE_PT,
    legend_above,
    new_figure,
    offsets,
    picture,
)
from tams_app.study.report.summary_section import received_ssim, success_share
from tams_app.study.report.wording import interval, name
from tams_app.study.results import StudyData, TrialResult

_RIGHT, _LEFT = "better →", "← better"


@dataclass(frozen=True, slots=True)
class _Quantity:
    title: str
    better: str
    measure: Measure
    digits: int


def differences_section(data: StudyData) -> Section:
    """The proposed strategy minus each other one, on every network."""
    return Section("Paired differences", (_figure(data), _table(data)))


def _quantities(data: StudyData) -> tuple[_Quantity, ...]:
    def censored_s(result: TrialResult) -> float | None:
        return result.censored_time_s(data.limit_s)

    return (
        _Quantity("Received SSIM", _RIGHT, received_ssim, 4),
        _Quantity(f"Time, censored at {data.limit_s:g} s [s]", _LEFT, censored_s, 2),
        _Quantity("Success [share]", _RIGHT, success_share, 3),
    )


def _figure(data: StudyData) -> Picture:
    quantities = _quantities(data)
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
                if found is None:
                    continue
                error = None
                if found.low is not None and found.high is not None:
                    error = [[found.value - found.low], [found.high - found.value]]
                axis.errorbar(
                    found.value,
                    row + shift,
                    xerr=error,
                    fmt=MARKERS[place % len(MARKERS)],
                    color=COLOURS[place % len(COLOURS)],
                    markeredgecolor=INK,
                    markeredgewidth=0.5,
                    ecolor=INK,
                    elinewidth=0.9,
                    capsize=2.5,
                    label=f"against {name(other)}" if row == 0 else None,
                )
        axis.set_title(quantity.title, fontsize=TITLE_PT)
        axis.set_xlabel(quantity.better, fontsize=SMALL_PT)
        axis.set_ylim(len(networks) - 0.5, -0.5)
        axis.set_yticks(range(len(networks)), [name(one) for one in networks])
        axis.tick_params(labelsize=SMALL_PT)
    legend_above(figure, axes[0])
    caption = (
        f"{name(data.plan.proposed)} minus the other strategy over pairs of trials with the same "
        "scene, noise and losses; bootstrapped 95 % intervals over participants."
    )
    return picture(figure, "differences", caption, "The values are those of the table below.")


def _table(data: StudyData) -> Table:
    quantities = _quantities(data)
    rows = tuple(
        (f"{name(network)}, against {name(other)}", *_cells(data, other, network, quantities))
        for network in data.plan.networks
        for other in others(data)
    )
    header = ("Comparison", *(quantity.title for quantity in quantities), "Pairs")
    caption = f"Paired differences, {name(data.plan.proposed)} minus the other, 95 % intervals"
    return Table(caption, header, rows)


def _cells(
    data: StudyData, other: str, network: str, quantities: Sequence[_Quantity]
) -> tuple[str, ...]:
    found = [compare(data, other, network, quantity.measure) for quantity in quantities]
    cells = [
        interval(one.estimate, quantity.digits, signed=True)
        for one, quantity in zip(found, quantities, strict=True)
    ]
    return (*cells, str(max(one.pairs for one in found)))
