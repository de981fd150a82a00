"""What holds and what does not, in sentences that one rule makes of every comparison."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass
from enum import StrEnum

from tams_app.study.report.measures import Measures
from tams_app.study.report.wording import counted, interval, name, p_value
from tams_app.study.statistics import PairedDifference


@dataclass(frozen=True, slots=True)
class Quantity:
    """A column of the trials that strategies are compared by."""

    title: str
    column: str
    digits: int
    more_is_better: bool = True
    unit: str = ""

    @property
    def better(self) -> str:
        """The direction on an axis."""
        return "better →" if self.more_is_better else "← better"


@dataclass(frozen=True, slots=True)
class Claim:
    """A claim of the paper, how many comparisons it holds in, and a sentence for each of them."""

    text: str
    tally: str
    sentences: tuple[str, ...]


class TestedClaim(StrEnum):
    """What the test says of a claim."""

    HOLDS = "holds"
    OPPOSITE = "the opposite holds"
    NOT_SHOWN = "no difference shown"
    UNKNOWN = "not known"


def judge(found: PairedDifference, *, more_is_better: bool) -> TestedClaim:
    """Whether the proposed strategy wins, decided by the paired t test alone."""
    if found.estimate is None or found.estimate.low is None:
        return TestedClaim.UNKNOWN
    if not found.is_shown:
        return TestedClaim.NOT_SHOWN
    wins = (found.estimate.value > 0) == more_is_better
    return TestedClaim.HOLDS if wins else TestedClaim.OPPOSITE


def claims(measures: Measures) -> list[Claim]:
    """The paper's three claims."""
    limit_s = measures.data.limit_s
    proposed = name(measures.data.plan.proposed)
    return [
        _claim(measures, f"{proposed} {text}", quantity)
        for text, quantity in zip(
            (
                "gives the higher SSIM of the primary view (received frames)",
                f"shortens the task (times censored at {limit_s:g} s)",
                "raises the success rate (differences as shares)",
            ),
            compared(limit_s),
            strict=True,
        )
    ]


def compared(limit_s: float) -> tuple[Quantity, ...]:
    """What the paper's claims are about."""
    time = f"Time, censored at {limit_s:g} s [s]"
    return (
        Quantity("Received SSIM", "primary_received_ssim", 4),
        Quantity(time, "censored_time_s", 2, more_is_better=False, unit=" s"),
        Quantity("Success [share]", "success_share", 3),
    )


PARTS = (
    Quantity("Received SSIM", "summed_ssim", 4),
    Quantity("Its part by coding", "undamaged_ssim", 4),
    Quantity("Its part by loss", "lost_ssim", 4),
)


def _claim(measures: Measures, text: str, quantity: Quantity) -> Claim:
    plan = measures.data.plan
    found = [
        (other, network, measures.difference(other, network, quantity.column))
        for network in plan.networks
        for other in measures.others
    ]
    findings = Counter(judge(one, more_is_better=quantity.more_is_better) for *_, one in found)
    counts = ", ".join(f"{one.value}: {findings[one]}" for one in TestedClaim if findings[one])
    return Claim(
        text,
        f"{counted(len(found), 'comparison')}: {counts}",
        tuple(
            f"{name(network)}, {name(plan.proposed)} against {name(other)}: "
            f"{difference_sentence(one, quantity)}"
            for other, network, one in found
        ),
    )


def difference_sentence(found: PairedDifference, quantity: Quantity) -> str:
    """The finding with its reason and its numbers, worded alike whichever side it favours."""
    finding = judge(found, more_is_better=quantity.more_is_better)
    if found.estimate is None:
        return f"{finding.value} (there is no pair of trials)."
    if finding is TestedClaim.UNKNOWN:
        why = f"{counted(found.estimate.n, 'participant')}: too few to test"
    else:
        why = f"paired t test, {p_value(found.p or 0.0)}"
    numbers = interval(found.estimate, quantity.digits, signed=True)
    left_out = f", {counted(found.unpaired, 'trial')} without counterpart" if found.unpaired else ""
    pairs = counted(found.pairs, "pair")
    return f"{finding.value} ({why}); difference {numbers}{quantity.unit} over {pairs}{left_out}."
