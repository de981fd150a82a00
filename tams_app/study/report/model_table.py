"""The mixed model of completion times, as tables or as the reason why there is none."""

from __future__ import annotations

from collections.abc import Callable

from tams_app.study.report import paper
from tams_app.study.report.blocks import Block, Paragraph, Table
from tams_app.study.report.wording import name, number, p_value, term_name
from tams_app.study.results import StudyData, TrialResult
from tams_app.study.statistics.mixed_model import (
    MixedModel,
    NotFitted,
    fit_mixed_model,
    interaction_columns,
)

_SCENES = (
    "Strategies share their scenes, networks do not, and the model knows neither. Its terms of "
    "networks include chance differences between scenes and look surer than they are; its standard "
    "errors of strategies contain what a scene does to all of them and are wider than need be. The "
    "paired differences below are free of both."
)


def model_blocks(data: StudyData) -> list[Block]:
    """One model of the completed trials, as in the paper, and one of the censored times."""
    limit = f"{data.limit_s:g} s"
    blocks = [
        *_blocks(data, "completed trials only", lambda one: one.completed_time_s),
        *_blocks(data, f"censored at {limit}", lambda one: one.censored_time_s(data.limit_s)),
    ]
    if any(isinstance(block, Table) for block in blocks):
        blocks.append(Paragraph(_SCENES))
    return blocks


def fit(data: StudyData, measure: Callable[[TrialResult], float | None]) -> MixedModel | NotFitted:
    """The reference strategy and the first network are the model's reference levels."""
    plan = data.plan
    levels = (plan.reference, *(one for one in plan.strategies if one != plan.reference))
    rows = [(one, value) for one in data.results if (value := measure(one)) is not None]
    columns = interaction_columns(
        [one.strategy for one, _ in rows], [one.network for one, _ in rows], levels, plan.networks
    )
    return fit_mixed_model([value for _, value in rows], columns, [r.participant for r, _ in rows])


def _blocks(
    data: StudyData, what: str, measure: Callable[[TrialResult], float | None]
) -> list[Block]:
    found = fit(data, measure)
    title = "Linear mixed-effects model, time ~ strategy × network + (1 | participant)"
    if isinstance(found, NotFitted):
        return [Paragraph(f"{title}, {what}: {found.reason}")]
    rows = tuple(
        (
            term_name(term.name),
            number(term.beta, 2, signed=True),
            number(term.standard_error, 2),
            f"[{number(term.low, 2, signed=True)}, {number(term.high, 2, signed=True)}]",
            number(term.z, 2),
            p_value(term.p),
            _theirs(term.name),
        )
        for term in found.terms
    )
    header = ("Term", "β [s]", "SE [s]", "95 % interval", "z", "p", f"β (SE), {paper.SOURCE}")
    reference = f"{name(data.plan.reference)} on {name(data.plan.networks[0])}"
    caption = f"{title}, {what}; reference: {reference}"
    fitted = (
        f"{found.n} trials of {found.groups} participants; standard deviation between participants "
        f"{found.group_sd:.2f} s, residual {found.residual_sd:.2f} s."
    )
    return [Table(caption, header, rows), Paragraph(" ".join((fitted, *found.remarks)))]


def _theirs(term: str) -> str:
    if term != paper.INTERACTION:
        return ""
    return f"{number(paper.INTERACTION_BETA_S, 2)} ({number(paper.INTERACTION_SE_S, 2)})"
