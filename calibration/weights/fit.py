"""The rule that makes the view weight matrix W from ratings. Pure, and exact to its last digit.

The paper (III-C) fixes the form: the view most often named most critical gets the largest share,
the others keep some. It does not give the numbers; ours are the extremes of its Table I. With V
views:

1. Every view gets 0.6/V (Table I's smallest share, 0.20 of three).
2. Of the 0.4 that remain the dominant view gets 5/8 if the raters' votes are spread evenly over all
   views and everything if they are unanimous, in between in proportion to its share of the votes
   above 1/V. That makes 0.45 to 0.60 of three views, Table I's smallest and largest dominant share:
   the less the raters agree, the flatter the row.
3. The others divide what is left in proportion to their mean necessity above the scale's least, so
   in its order. Each is cut off to whole hundredths; the dominant view gets the odd ones.

The dominant view is the most often named; if several are, the most necessary of them; if that
does not tell either, the one with the most in the present row, then the first of the
configuration. Every such decision, and every disagreement, is among the `remarks`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import floor

from calibration.weights.ratings import LEAST, Answer, Sheet, answers_on
from tams_app.records import Phase

HUNDREDTHS = 100
GUARANTEED = Fraction(6, 10)  # of a row, in equal parts
LEAST_LEAD, WHOLE = Fraction(5, 8), Fraction(1)  # of the rest, for the dominant view


@dataclass(frozen=True, slots=True)
class PhaseWeights:
    """One row of W and how it came about; `necessity` is the mean, None where no rater rated it.

    `dominant` None: the phase was not rated, and `shares` is the present row.
    """

    phase: Phase
    shares: dict[str, float]
    dominant: str | None
    votes: dict[str, int]
    necessity: dict[str, float | None]
    remarks: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class _Ballot:
    """The ratings of one phase in exact numbers."""

    votes: dict[str, int]
    necessity: dict[str, Fraction]  # mean


def smallest_share(views: int) -> float:
    """What every view keeps at least, in whole hundredths: 0.20 of three."""
    return floor(HUNDREDTHS * GUARANTEED / views) / HUNDREDTHS


def fit_weights(
    sheets: Sequence[Sheet],
    views: Sequence[str],
    present: Mapping[Phase, Mapping[str, float]],
) -> dict[Phase, PhaseWeights]:
    """W from `sheets`; `present` is the matrix in force. Rows sum to 1 in their two decimals."""
    return {phase: _row(phase, answers_on(sheets, phase), views, present[phase]) for phase in Phase}


def _row(
    phase: Phase, answers: Sequence[Answer], views: Sequence[str], present: Mapping[str, float]
) -> PhaseWeights:
    votes = {view: sum(answer.most_critical == view for answer in answers) for view in views}
    means = {view: _mean_necessity(answers, view) for view in views}
    shown = {view: None if mean is None else float(mean) for view, mean in means.items()}
    rated = {view: mean for view, mean in means.items() if mean is not None}
    if not any(votes.values()) or len(rated) < len(views):
        remark = f"keeps its present row: {_what_lacks(answers, votes, means)}"
        return PhaseWeights(phase, dict(present), None, votes, shown, (remark,))
    ballot = _Ballot(votes, rated)
    dominant, remarks = _dominant(ballot, present)
    shares = _shares(ballot, dominant)
    remarks += _disagreement(ballot, dominant)
    return PhaseWeights(phase, shares, dominant, votes, shown, tuple(remarks))


def _mean_necessity(answers: Sequence[Answer], view: str) -> Fraction | None:
    given = [value for answer in answers if (value := answer.necessity.get(view)) is not None]
    return Fraction(sum(given), len(given)) if given else None


def _what_lacks(
    answers: Sequence[Answer], votes: Mapping[str, int], means: Mapping[str, Fraction | None]
) -> str:
    if not answers:
        return "no rater rated it"
    if not any(votes.values()):
        return "no rater named its most critical view"
    unrated = [view for view, mean in means.items() if mean is None]
    return f"no rater rated the necessity of {' and '.join(unrated)}"


def _dominant(ballot: _Ballot, present: Mapping[str, float]) -> tuple[str, list[str]]:
    """The dominant view, and what had to be decided beyond the votes."""
    most = max(ballot.votes.values())
    leaders = [view for view, count in ballot.votes.items() if count == most]
    if len(leaders) == 1:
        return leaders[0], []
    tie = f"tie: {' and '.join(leaders)} were named most critical equally often ({most} times)"
    highest = max(ballot.necessity[view] for view in leaders)
    needed = [view for view in leaders if ballot.necessity[view] == highest]
    if len(needed) == 1:
        return needed[0], [f"{tie}; {needed[0]} is the more necessary and taken"]
    led = max(present.get(view, 0.0) for view in needed)
    before = [view for view in needed if present.get(view, 0.0) == led]
    why = "for its present share" if len(before) == 1 else "for it is named first"
    return before[0], [
        f"{tie} and are equally necessary; {before[0]} is taken {why}: ask more raters"
    ]


def _shares(ballot: _Ballot, dominant: str) -> dict[str, float]:
    """The rule's shares; exact fractions until the cut to hundredths."""
    views = list(ballot.votes)
    if len(views) == 1:
        return {dominant: 1.0}
    guaranteed, rest = GUARANTEED / len(views), 1 - GUARANTEED
    even = Fraction(1, len(views))
    share_of_votes = Fraction(ballot.votes[dominant], sum(ballot.votes.values()))
    lead = LEAST_LEAD + (WHOLE - LEAST_LEAD) * (share_of_votes - even) / (1 - even)
    others = {view: mean - LEAST for view, mean in ballot.necessity.items() if view != dominant}
    total = sum(others.values())
    left = rest * (1 - lead)
    hundredths = {}
    for view, above in others.items():
        part = above / total if total else Fraction(1, len(others))
        hundredths[view] = floor(HUNDREDTHS * (guaranteed + left * part))
    hundredths[dominant] = HUNDREDTHS - sum(hundredths.values())
    return {view: hundredths[view] / HUNDREDTHS for view in views}


def _disagreement(ballot: _Ballot, dominant: str) -> list[str]:
    remarks = []
    named, voters = ballot.votes[dominant], sum(ballot.votes.values())
    if voters > 1 and 2 * named <= voters:
        remarks.append(f"no majority: {named} of {voters} named {dominant} most critical")
    more = [view for view, mean in ballot.necessity.items() if mean > ballot.necessity[dominant]]
    if more:
        remarks.append(
            f"{dominant} is most often named most critical, but {' and '.join(more)} "
            f"{'is' if len(more) == 1 else 'are'} rated more necessary"
        )
    return remarks
