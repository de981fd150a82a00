"""The proposed strategy against each other one, on pairs of trials that share everything else."""

from __future__ import annotations

from collections.abc import Callable
from enum import StrEnum

from tams_app.study.report.wording import counted, interval, name
from tams_app.study.results import StudyData, TrialResult
from tams_app.study.statistics.pairs import Key, PairedDifference, paired_difference

Measure = Callable[[TrialResult], float | None]


def others(data: StudyData) -> tuple[str, ...]:
    """Every strategy but the proposed one."""
    return tuple(one for one in data.plan.strategies if one != data.plan.proposed)


def compare(data: StudyData, other: str, network: str, measure: Measure) -> PairedDifference:
    """Proposed minus `other` on one network."""
    return paired_difference(
        _values(data, data.plan.proposed, network, measure), _values(data, other, network, measure)
    )


class Finding(StrEnum):
    """What an interval says of a claim."""

    HOLDS = "holds"
    OPPOSITE = "the opposite holds"
    NOT_SHOWN = "no difference shown"
    UNKNOWN = "not known"


def judge(found: PairedDifference, *, more_is_better: bool) -> Finding:
    """Whether the proposed strategy wins, decided by the interval alone."""
    estimate = found.estimate
    if estimate is None or estimate.low is None:
        return Finding.UNKNOWN
    if not estimate.excludes_zero:
        return Finding.NOT_SHOWN
    wins = (estimate.value > 0) == more_is_better
    return Finding.HOLDS if wins else Finding.OPPOSITE


def difference_sentence(
    data: StudyData,
    other: str,
    network: str,
    found: PairedDifference,
    *,
    more_is_better: bool,
    digits: int,
    unit: str = "",
) -> str:
    """The finding with its reason and its numbers."""
    finding = judge(found, more_is_better=more_is_better)
    clause = (
        f"{name(network)}, {name(data.plan.proposed)} against {name(other)}: {finding.value} "
        f"({_because(finding, found)})"
    )
    if found.estimate is None:
        return f"{clause}."
    numbers = interval(found.estimate, digits, signed=True)
    left_out = f", {counted(found.unpaired, 'trial')} without counterpart" if found.unpaired else ""
    pairs = counted(found.pairs, "pair")
    return f"{clause}; difference {numbers}{unit} over {pairs}{left_out}."


def _because(finding: Finding, found: PairedDifference) -> str:
    if found.estimate is None:
        return "there is no pair of trials"
    if finding is Finding.UNKNOWN:
        return f"{counted(found.estimate.n, 'participant')}: too few for an interval"
    return f"the interval {'includes' if finding is Finding.NOT_SHOWN else 'excludes'} 0"


def _values(data: StudyData, strategy: str, network: str, measure: Measure) -> dict[Key, float]:
    values = {
        (one.participant, one.trial.repetition): measure(one) for one in data.of(strategy, network)
    }
    return {key: value for key, value in values.items() if value is not None}
