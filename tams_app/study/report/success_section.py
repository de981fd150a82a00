"""Success rates with Wilson's intervals, beside the paper's."""

from __future__ import annotations

from tams_app.study.report import paper
from tams_app.study.report.blocks import Paragraph, Picture, Section, Table
from tams_app.study.report.drawing import (
    COLOURS,
    HATCHES,
    INK,
    SMALL_PT,
    TEXT_PT,
    legend_above,
    new_figure,
    offsets,
    picture,
)
from tams_app.study.report.wording import NONE, name, percent
from tams_app.study.results import StudyData
from tams_app.study.statistics.intervals import Estimate, wilson_interval

_WIDTH = 0.78


def success_section(data: StudyData) -> Section:
    """Trials that nobody has judged are left out, and counted."""
    rules = data.config.trial
    text = (
        f"Success: placed within {rules.success_within_s:g} s with at most {rules.max_drops} "
        f"drops. Completed: placed within {rules.limit_s:g} s."
    )
    return Section("Success", (Paragraph(text), _figure(data), _table(data)))


def share(data: StudyData, strategy: str, network: str) -> Estimate | None:
    """The share of successes among the trials that were judged."""
    judged = [one.success for one in data.of(strategy, network) if one.success is not None]
    return wilson_interval(sum(judged), len(judged))


def _figure(data: StudyData) -> Picture:
    figure, (axis,) = new_figure(3.0)
    strategies, networks = data.plan.strategies, data.plan.networks
    width = _WIDTH / len(strategies) * 0.9
    paper_shown = False
    for place, (strategy, shift) in enumerate(
        zip(strategies, offsets(len(strategies), _WIDTH), strict=True)
    ):
        axis.bar(
            [0],
            [0],
            color=COLOURS[place],
            hatch=HATCHES[place],
            edgecolor=INK,
            label=name(strategy),
        )
        for column, network in enumerate(networks):
            found = share(data, strategy, network)
            if found is None or found.low is None or found.high is None:
                continue
            percentage = 100 * found.value
            axis.bar(
                column + shift,
                percentage,
                width,
                color=COLOURS[place % len(COLOURS)],
                hatch=HATCHES[place % len(HATCHES)],
                edgecolor=INK,
                linewidth=0.6,
                alpha=0.8,
                yerr=[[percentage - 100 * found.low], [100 * found.high - percentage]],
                error_kw={"ecolor": INK, "elinewidth": 0.9, "capsize": 3},
            )
            axis.annotate(
                f"{percentage:.0f} %",
                (column + shift, 100 * found.high),
                xytext=(0, 2),
                textcoords="offset points",
                ha="center",
                fontsize=SMALL_PT,
            )
            theirs = paper.SUCCESS_SHARE.get((strategy, network))
            if theirs is not None:
                label = None if paper_shown else "paper, people"
                paper_shown = True
                axis.plot(
                    column + shift,
                    100 * theirs,
                    "D",
                    markerfacecolor="white",
                    markeredgecolor=INK,
                    markersize=5,
                    label=label,
                )
    axis.set_ylim(0, 112)
    axis.set_yticks(range(0, 101, 20))
    axis.set_xlim(-0.5, len(networks) - 0.5)
    axis.set_xticks(range(len(networks)), [name(one) for one in networks], fontsize=TEXT_PT)
    axis.set_ylabel("Success [%]", fontsize=TEXT_PT)
    legend_above(figure, axis)
    whose = " of the simulated operator" if data.plan.simulated else ""
    caption = f"Success rates{whose} with Wilson's 95 % intervals; white diamonds: the paper's."
    return picture(figure, "success", caption, "The values are those of the table below.")


def _table(data: StudyData) -> Table:
    rows = []
    for network in data.plan.networks:
        for strategy in data.plan.strategies:
            results = data.of(strategy, network)
            judged = [one for one in results if one.success is not None]
            done = [one for one in results if one.completed is not None]
            drops = [one.drops for one in results if one.drops is not None]
            rows.append(
                (
                    f"{name(network)}, {name(strategy)}",
                    f"{sum(bool(one.success) for one in judged)} of {len(judged)}",
                    percent(share(data, strategy, network)),
                    percent(wilson_interval(sum(bool(one.completed) for one in done), len(done))),
                    f"{sum(drops) / len(drops):.2f}" if drops else NONE,
                    _theirs(strategy, network),
                )
            )
    whose = "simulated operator" if data.plan.simulated else "this study"
    header = (
        "Condition",
        "Successes",
        f"Success rate, {whose}",
        "Completion rate",
        "Drops per trial",
        f"Success rate, {paper.SOURCE}",
    )
    return Table("Success and completion with Wilson's 95 % intervals", header, tuple(rows))


def _theirs(strategy: str, network: str) -> str:
    share_ = paper.SUCCESS_SHARE.get((strategy, network))
    if share_ is not None:
        return f"{100 * share_:.0f} %"
    known = (strategy, network) in paper.COMPLETION_TIME_S
    return paper.SUCCESS_S1_TEXT if known and network == "s1" else NONE
