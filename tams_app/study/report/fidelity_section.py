"""SSIM of the primary view: overall beside the paper's, and by phase."""

from __future__ import annotations

from tams_app.study.report import paper
from tams_app.study.report.blocks import Block, Paragraph, Picture, Section, Table
from tams_app.study.report.comparing import compare, others
from tams_app.study.report.drawing import (
    INK,
    MARKERS,
    SMALL_PT,
    TEXT_PT,
    TITLE_PT,
    draw_estimate,
    legend_above,
    new_figure,
    offsets,
    picture,
)
from tams_app.study.report.wording import PHASES, interval, listed, name, number, phase_name
from tams_app.study.results import SSIM_KINDS, StudyData, TrialResult, participant_means
from tams_app.study.statistics.intervals import Estimate, mean_interval


def fidelity_section(data: StudyData) -> Section:
    """Figures and tables; where the proposed strategy loses, the phases in which it does."""
    if not any(one.primary_ssim("received_ssim") is not None for one in data.results):
        return Section("Visual fidelity", (Paragraph("No frame of any trial was scored."),))
    blocks: list[Block] = [
        _overall_table(data),
        _overall_figure(data),
        _phase_figure(data),
        *(_phase_table(data, network) for network in data.plan.networks),
        *(Paragraph(text) for text in _where_it_differs(data)),
    ]
    return Section("Visual fidelity", tuple(blocks))


def estimate(
    data: StudyData, strategy: str, network: str, kind: str, phase: str | None = None
) -> Estimate | None:
    """Mean and interval over participants."""
    results = data.of(strategy, network)
    values = [one.primary_ssim(kind, phase) for one in results]
    return mean_interval(participant_means(results, values))


def _overall_table(data: StudyData) -> Table:
    rows = []
    for network in data.plan.networks:
        for strategy in data.plan.strategies:
            cells = [interval(estimate(data, strategy, network, kind), 3) for kind in SSIM_KINDS]
            theirs = number(paper.RECEIVED_SSIM.get((strategy, network)), 3)
            rows.append((f"{name(network)}, {name(strategy)}", *cells, theirs))
    whose = "simulated operator" if data.plan.simulated else "this study"
    header = (
        "Condition",
        f"Received, {whose}",
        "Delivered",
        "Live",
        f"Received, {paper.SOURCE}",
    )
    caption = (
        "SSIM of the primary view, mean of the phase means, with 95 % intervals over participants. "
        "Received: frames shown; delivered: every captured frame; live: what was on screen"
    )
    return Table(caption, header, tuple(rows))


def _overall_figure(data: StudyData) -> Picture:
    figure, (axis,) = new_figure(2.8)
    networks, strategies = data.plan.networks, data.plan.strategies
    for place, (strategy, shift) in enumerate(
        zip(strategies, offsets(len(strategies), 0.5), strict=True)
    ):
        for column, network in enumerate(networks):
            first = column == 0
            draw_estimate(
                axis,
                column + shift,
                estimate(data, strategy, network, "received_ssim"),
                place,
                name(strategy) if first else None,
            )
            theirs = paper.RECEIVED_SSIM.get((strategy, network))
            if theirs is not None:
                label = "paper, people" if first and place == 0 else None
                axis.plot(
                    column + shift + 0.06,
                    theirs,
                    marker=MARKERS[place],
                    markerfacecolor="none",
                    markeredgecolor=INK,
                    linestyle="none",
                    markersize=6,
                    label=label,
                )
    axis.set_xticks(range(len(networks)), [name(one) for one in networks], fontsize=TEXT_PT)
    axis.set_ylabel("Received SSIM, primary view", fontsize=TEXT_PT)
    legend_above(figure, axis)
    caption = (
        "Received SSIM of the primary view, 95 % intervals over participants"
        f"{_whose(data)}; hollow: the paper's people."
    )
    return picture(figure, "ssim", caption, "The values are those of the table above.")


def _phase_figure(data: StudyData) -> Picture:
    networks, strategies = data.plan.networks, data.plan.strategies
    figure, axes = new_figure(3.4, len(networks), share_y=False)
    for axis, network in zip(axes, networks, strict=True):
        for place, (strategy, shift) in enumerate(
            zip(strategies, offsets(len(strategies), 0.6), strict=True)
        ):
            for column, phase in enumerate(PHASES):
                found = estimate(data, strategy, network, "received_ssim", phase)
                label = name(strategy) if column == 0 else None
                draw_estimate(axis, column + shift, found, place, label)
        names = [phase_name(phase) for phase in PHASES]
        axis.set_xticks(range(len(PHASES)), names, rotation=35, ha="right", fontsize=SMALL_PT)
        axis.set_title(name(network), fontsize=TITLE_PT)
    axes[0].set_ylabel("Received SSIM, primary view", fontsize=TEXT_PT)
    legend_above(figure, axes[0])
    caption = (
        "Received SSIM of the primary view by phase, 95 % intervals over participants"
        f"{_whose(data)}. Each network has its own scale."
    )
    return picture(figure, "ssim_phases", caption, "The values are those of the tables below.")


def _phase_table(data: StudyData, network: str) -> Table:
    rows = tuple(
        (
            phase_name(phase),
            *(
                interval(estimate(data, strategy, network, "received_ssim", phase), 3)
                for strategy in data.plan.strategies
            ),
        )
        for phase in PHASES
    )
    header = ("Phase", *(name(one) for one in data.plan.strategies))
    return Table(f"Received SSIM of the primary view by phase on {name(network)}", header, rows)


def _where_it_differs(data: StudyData) -> list[str]:
    """Phase by phase, against each other strategy: better, worse, or not told apart."""
    sentences = []
    for network in data.plan.networks:
        for other in others(data):
            sides: dict[str, list[str]] = {"higher": [], "lower": [], "not told apart": []}
            for phase in PHASES:
                side = _side(data, other, network, phase)
                if side:
                    sides[side].append(phase_name(phase))
            told = [f"{side} in {listed(found)}" for side, found in sides.items() if found]
            if told:
                sentences.append(
                    f"{name(network)}, {name(data.plan.proposed)} against {name(other)}, by phase "
                    f"(paired): {'; '.join(told)}."
                )
    return sentences


def _side(data: StudyData, other: str, network: str, phase: str) -> str | None:
    def measure(result: TrialResult) -> float | None:
        return result.primary_ssim("received_ssim", phase)

    found = compare(data, other, network, measure).estimate
    if found is None or found.low is None:
        return None
    if not found.excludes_zero:
        return "not told apart"
    return "higher" if found.value > 0 else "lower"


def _whose(data: StudyData) -> str:
    return " (simulated operator)" if data.plan.simulated else ""
