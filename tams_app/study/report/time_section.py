"""Completion times: figure, Welch's tests as in the paper, censored times, mixed model, pairs."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes

from tams_app.study.report import paper
from tams_app.study.report.blocks import Block, Paragraph, Picture, Section, Table
from tams_app.study.report.drawing import (
    COLOURS,
    INK,
    TEXT_PT,
    legend_above,
    new_figure,
    offsets,
    picture,
)
from tams_app.study.report.model_table import model_blocks
from tams_app.study.report.wording import NONE, interval, name, number, p_value
from tams_app.study.results import StudyData
from tams_app.study.statistics.intervals import mean_interval
from tams_app.study.statistics.welch import Welch, stars, welch

_JITTER_SEED = 5
_BOX_WIDTH = 0.8


def time_section(data: StudyData) -> Section:
    """Completed-only times beside times in which an uncompleted trial counts with the limit."""
    if not any(completed(data, s, n) for s in data.plan.strategies for n in data.plan.networks):
        return Section("Completion time", (Paragraph("No trial was completed."),))
    blocks: list[Block] = [
        _figure(data),
        _means_table(data),
        _welch_table(data),
        *model_blocks(data),
    ]
    return Section("Completion time", tuple(blocks))


def completed(data: StudyData, strategy: str, network: str) -> list[float]:
    """Times of completed trials [s]."""
    times = [one.completed_time_s for one in data.of(strategy, network)]
    return [time for time in times if time is not None]


def censored(data: StudyData, strategy: str, network: str) -> list[float]:
    """Times [s], the limit where the block was not placed."""
    times = [one.censored_time_s(data.limit_s) for one in data.of(strategy, network)]
    return [time for time in times if time is not None]


def _test(data: StudyData, network: str) -> Welch | None:
    plan = data.plan
    if plan.proposed == plan.reference:
        return None
    return welch(completed(data, plan.proposed, network), completed(data, plan.reference, network))


def _figure(data: StudyData) -> Picture:
    figure, (axis,) = new_figure(3.6)
    plan = data.plan
    shifts = offsets(len(plan.strategies), _BOX_WIDTH)
    width = _BOX_WIDTH / len(plan.strategies) * 0.75
    random = np.random.default_rng(_JITTER_SEED)
    top = 0.0
    for place, (strategy, shift) in enumerate(zip(plan.strategies, shifts, strict=True)):
        for column, network in enumerate(plan.networks):
            times = completed(data, strategy, network)
            if times:
                _draw_box(axis, times, column + shift, width, place, random)
                top = max(top, *times)
    _mark_tests(axis, data, shifts, top)
    for place, strategy in enumerate(plan.strategies):
        axis.fill_between([], [], color=COLOURS[place % len(COLOURS)], label=name(strategy))
    legend_above(figure, axis)
    axis.set_xlim(-0.5, len(plan.networks) - 0.5)
    axis.set_xticks(range(len(plan.networks)), [name(n) for n in plan.networks], fontsize=TEXT_PT)
    axis.set_ylabel("Completion time [s]", fontsize=TEXT_PT)
    whose = " of the simulated operator" if plan.simulated else ""
    caption = (
        f"Completion times{whose}, completed trials only: quartiles and median, whiskers 5th to "
        f"95th percentile, a dot per trial. Marks: Welch's t-test, {name(plan.proposed)} against "
        f"{name(plan.reference)} (ns, * p < .05, ** p < .01, *** p < .001)."
    )
    return picture(figure, "completion_time", caption, "The means are those of the table below.")


def _draw_box(
    axis: Axes,
    times: list[float],
    x: float,
    width: float,
    place: int,
    random: np.random.Generator,
) -> None:
    axis.boxplot(
        [times],
        positions=[x],
        widths=width,
        whis=(5, 95),
        showfliers=False,
        patch_artist=True,
        manage_ticks=False,
        boxprops={"facecolor": COLOURS[place % len(COLOURS)], "alpha": 0.55, "edgecolor": INK},
        medianprops={"color": INK, "linewidth": 1.6},
        whiskerprops={"color": INK, "linewidth": 0.9},
        capprops={"color": INK, "linewidth": 0.9},
    )
    scattered = x + random.uniform(-0.35, 0.35, len(times)) * width
    axis.plot(scattered, times, ".", color=INK, alpha=0.45, markersize=3.5)


def _mark_tests(axis: Axes, data: StudyData, shifts: list[float], top: float) -> None:
    """A bracket over reference and proposed strategy with the test's mark."""
    strategies = data.plan.strategies
    ends = [shifts[strategies.index(one)] for one in (data.plan.reference, data.plan.proposed)]
    for column, network in enumerate(data.plan.networks):
        found = _test(data, network)
        if found is None:
            continue
        left, right = (column + end for end in sorted(ends))
        height = 1.05 * top
        axis.plot(
            [left, left, right, right],
            [height * 0.985, height, height, height * 0.985],
            color=INK,
            linewidth=0.9,
        )
        axis.text(
            (left + right) / 2,
            height * 1.005,
            stars(found.p),
            ha="center",
            va="bottom",
            fontsize=TEXT_PT,
        )
    axis.set_ylim(0, 1.16 * top)


def _means_table(data: StudyData) -> Table:
    rows = []
    for network in data.plan.networks:
        for strategy in data.plan.strategies:
            done = completed(data, strategy, network)
            everyone = censored(data, strategy, network)
            rows.append(
                (
                    f"{name(network)}, {name(strategy)}",
                    f"{len(done)} of {len(everyone)}",
                    interval(mean_interval(done), 1),
                    interval(mean_interval(everyone), 1),
                    number(float(np.median(everyone)) if everyone else None, 1),
                    number(paper.COMPLETION_TIME_S.get((strategy, network)), 1),
                )
            )
    whose = "simulated operator" if data.plan.simulated else "this study"
    limit = f"{data.limit_s:g} s"
    header = (
        "Condition",
        "Completed",
        f"Mean, completed only, {whose} [s]",
        f"Mean, censored at {limit} [s]",
        "Median, censored [s]",
        f"Mean, {paper.SOURCE} [s]",
    )
    caption = (
        "Completion times with 95 % intervals over trials. Completed-only means leave out the "
        "slowest trials; censored ones count an uncompleted trial with the limit, which is still "
        "too short for it"
    )
    return Table(caption, header, tuple(rows))


def _welch_table(data: StudyData) -> Table:
    rows = []
    for network in data.plan.networks:
        found = _test(data, network)
        theirs = number(paper.COHENS_D.get(network), 2)
        if found is None:
            rows.append((name(network), NONE, NONE, NONE, NONE, theirs))
            continue
        rows.append(
            (
                name(network),
                f"{number(found.difference, 2, signed=True)} "
                f"[{number(found.low, 2, signed=True)}, {number(found.high, 2, signed=True)}]",
                f"t({found.df:.1f}) = {number(found.t, 2)}",
                f"{p_value(found.p)} ({stars(found.p)})",
                number(found.d, 2),
                theirs,
            )
        )
    header = ("Network", "Difference [s]", "Welch's t", "p", "Cohen's d", f"d, {paper.SOURCE}")
    caption = (
        f"Welch's t-test, {name(data.plan.proposed)} minus {name(data.plan.reference)}, completed "
        "trials only, as in the paper. It takes trials as independent, which those of one "
        "participant are not: the model and the paired differences do not"
    )
    return Table(caption, header, tuple(rows))
