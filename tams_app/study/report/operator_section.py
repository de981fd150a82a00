"""Which view the operator relied on, beside what W says he should, and how sure he was."""

from __future__ import annotations

from tams_app.policy.weights import WeightMatrix
from tams_app.records import Phase
from tams_app.study.report.blocks import Block, Paragraph, Picture, Section, Table
from tams_app.study.report.comparing import Measure
from tams_app.study.report.drawing import (
    COLOURS,
    HATCHES,
    INK,
    TEXT_PT,
    legend_above,
    new_figure,
    picture,
)
from tams_app.study.report.wording import PHASES, interval, name, number, phase_name
from tams_app.study.results import StudyData, TrialResult, participant_means
from tams_app.study.statistics.intervals import Estimate, mean_interval

_TITLE = "The operator: the view relied on, the weight matrix W, and how sure he was"


def operator_section(data: StudyData) -> Section:
    """Shares by phase against W; agreement: the share that W's primary view had."""
    if not any(one.relied_on for one in data.results):
        text = "No trial tells which view the operator relied on."
        return Section(_TITLE, (Paragraph(text),))
    blocks: list[Block] = [
        _figure(data),
        _table(data),
        _agreement_table(
            data,
            "Agreement: share that W's primary view had, mean of the phases, however short they "
            "are, 95 % intervals",
            lambda one: agreement(data, one),
        ),
        _agreement_table(
            data,
            "Agreement by glances: fraction of glances in which W's primary view told most, 95 % "
            "intervals",
            lambda one: one.glance_agreement,
        ),
    ]
    if any(one.uncertainty_mm for one in data.results):
        blocks.append(_uncertainty_table(data))
    return Section(_TITLE, tuple(blocks))


def _weights(data: StudyData) -> WeightMatrix:
    return WeightMatrix(data.config.policy.weights.matrix)


def _share(data: StudyData, phase: str, view: str) -> Estimate | None:
    results = list(data.results)
    values = [one.relied_on.get(phase, {}).get(view) for one in results]
    return mean_interval(participant_means(results, values))


def agreement(data: StudyData, result: TrialResult) -> float | None:
    """Mean over a trial's phases of the primary view's share of what glances told."""
    weights = _weights(data)
    shares = [
        by_view.get(weights.primary_view(Phase(phase)), 0.0)
        for phase, by_view in result.relied_on.items()
    ]
    return sum(shares) / len(shares) if shares else None


def _figure(data: StudyData) -> Picture:
    figure, (axis,) = new_figure(3.0)
    weights = _weights(data)
    heights = {"relied on": [0.0] * len(PHASES), "W": [0.0] * len(PHASES)}
    for place, view in enumerate(data.config.video.views):
        for shift, kind in ((-0.2, "relied on"), (0.2, "W")):
            for column, phase in enumerate(PHASES):
                found = _share(data, phase, view)
                share = weights.row(Phase(phase))[view] if kind == "W" else found and found.value
                axis.bar(
                    column + shift,
                    share or 0.0,
                    0.34,
                    bottom=heights[kind][column],
                    color=COLOURS[place + 1],
                    hatch=HATCHES[place],
                    edgecolor=INK,
                    linewidth=0.6,
                    alpha=0.9 if kind == "relied on" else 0.45,
                    label=view.upper() if kind == "relied on" and column == 0 else None,
                )
                heights[kind][column] += share or 0.0
    axis.set_xticks(range(len(PHASES)), [phase_name(one) for one in PHASES], fontsize=TEXT_PT)
    axis.set_ylabel("Share", fontsize=TEXT_PT)
    axis.set_ylim(0, 1.02)
    legend_above(figure, axis)
    caption = "Left bars: each view's share of what glances told; right, pale bars: the rows of W."
    return picture(figure, "relied_on", caption, "The shares are those of the table below.")


def _table(data: StudyData) -> Table:
    weights = _weights(data)
    views = data.config.video.views
    rows = tuple(
        (
            phase_name(phase),
            weights.primary_view(Phase(phase)).upper(),
            *(interval(_share(data, phase, view), 2) for view in views),
        )
        for phase in PHASES
    )
    header = ("Phase", "Primary view by W", *(f"Relied on {view.upper()}" for view in views))
    return Table(
        "Share of what glances told him of his way, mean over participants with 95 % intervals",
        header,
        rows,
    )


def _agreement_table(data: StudyData, caption: str, measure: Measure) -> Table:
    rows = []
    for strategy in data.plan.strategies:
        cells = []
        for network in data.plan.networks:
            results = data.of(strategy, network)
            values = [measure(one) for one in results]
            cells.append(interval(mean_interval(participant_means(results, values)), 2))
        rows.append((name(strategy), *cells))
    header = ("Strategy", *(name(one) for one in data.plan.networks))
    return Table(caption, header, tuple(rows))


def _uncertainty_table(data: StudyData) -> Table:
    """One row per stage of his task, in the order in which he comes to them."""
    longest_first = sorted(data.results, key=lambda one: -len(one.uncertainty_mm))
    stages = dict.fromkeys(stage for one in longest_first for stage in one.uncertainty_mm)
    conditions = [
        (strategy, network) for network in data.plan.networks for strategy in data.plan.strategies
    ]
    rows = tuple(
        (
            stage.capitalize(),
            *(number(_median_mm(data, stage, *condition), 2) for condition in conditions),
        )
        for stage in stages
    )
    header = ("Stage", *(f"{name(network)}, {name(one)}" for one, network in conditions))
    caption = (
        "How sure the simulated operator was: one standard deviation of the way to block or "
        "container [mm], as he judged it; medians of the trials, means over participants"
    )
    return Table(caption, header, rows)


def _median_mm(data: StudyData, stage: str, strategy: str, network: str) -> float | None:
    results = data.of(strategy, network)
    values = [one.uncertainty_mm.get(stage, {}).get("p50") for one in results]
    means = participant_means(results, values)
    return sum(means) / len(means) if means else None
