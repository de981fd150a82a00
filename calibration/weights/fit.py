"""The rule that makes the view weight matrix W from ratings, and how far the raters agree.

The rule is pure, and exact to its last digit. The paper (III-C) fixes its form: the view most often
named most critical gets the largest share, the others keep some. It does not give the numbers; ours
are the extremes of its Table I. With V views:

1. Every view gets 0.6/V (Table I's smallest share, 0.20 of three).
2. Of the 0.4 that remain the dominant view gets 5/8 if the raters' votes are spread evenly over all
   views and everything if they are unanimous, in between in proportion to its share of the votes
   above 1/V. That makes 0.45 to 0.60 of three views, Table I's smallest and largest dominant share:
   the less the raters agree, the flatter the row.
3. The others divide what is left in proportion to their mean necessity above the scale's least, so
   in its order. Each is cut off to whole hundredths; the dominant view gets the odd ones.

The dominant view is the most often named; if several are, the most necessary of them; if that
does not decide either, the one with the most in the present row, then the first of the
configuration. Every such decision, and every disagreement, is among the `remarks`.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction
from math import floor
from typing import Literal, TypeAlias

import numpy as np
from numpy.typing import NDArray

from calibration.weights.ratings import (
    LEAST,
    RatedPhase,
    Sheet,
    answers_on,
    critical_table,
    necessity_table,
)
from tams_app.printing import known
from tams_app.records import Phase

HUNDREDTHS = 100
GUARANTEED = Fraction(6, 10)  # of a row, in equal parts
LEAST_LEAD, WHOLE = Fraction(5, 8), Fraction(1)  # of the rest, for the dominant view


Votes: TypeAlias = Mapping[str, int]  # by view
Means: TypeAlias = Mapping[str, Fraction]  # necessity by view


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


def fit_weights(
    sheets: Sequence[Sheet],
    views: Sequence[str],
    present: Mapping[Phase, Mapping[str, float]],
) -> dict[Phase, PhaseWeights]:
    """W from `sheets`; `present` is the matrix in force. Rows sum to 1 in their two decimals."""
    return {phase: _row(phase, answers_on(sheets, phase), views, present[phase]) for phase in Phase}


def _row(
    phase: Phase, answers: Sequence[RatedPhase], views: Sequence[str], present: Mapping[str, float]
) -> PhaseWeights:
    votes = {view: sum(answer.most_critical == view for answer in answers) for view in views}
    means = {view: _mean_necessity(answers, view) for view in views}
    shown = {view: None if mean is None else float(mean) for view, mean in means.items()}
    rated = {view: mean for view, mean in means.items() if mean is not None}
    if not any(votes.values()) or len(rated) < len(views):
        remark = f"keeps its present row: {_what_lacks(answers, votes, means)}"
        return PhaseWeights(phase, dict(present), None, votes, shown, (remark,))
    dominant, remarks = _dominant(votes, rated, present)
    shares = _shares(votes, rated, dominant)
    remarks += _disagreement(votes, rated, dominant)
    return PhaseWeights(phase, shares, dominant, votes, shown, tuple(remarks))


def _mean_necessity(answers: Sequence[RatedPhase], view: str) -> Fraction | None:
    given = [value for answer in answers if (value := answer.necessity.get(view)) is not None]
    return Fraction(sum(given), len(given)) if given else None


def _what_lacks(
    answers: Sequence[RatedPhase], votes: Mapping[str, int], means: Mapping[str, Fraction | None]
) -> str:
    if not answers:
        return "no rater rated it"
    if not any(votes.values()):
        return "no rater named its most critical view"
    unrated = [view for view, mean in means.items() if mean is None]
    return f"no rater rated the necessity of {' and '.join(unrated)}"


def _dominant(
    votes: Votes, necessity: Means, present: Mapping[str, float]
) -> tuple[str, list[str]]:
    """The dominant view, and what had to be decided beyond the votes."""
    most = max(votes.values())
    leaders = [view for view, count in votes.items() if count == most]
    if len(leaders) == 1:
        return leaders[0], []
    tie = f"tie: {' and '.join(leaders)} were named most critical equally often ({most} times)"
    highest = max(necessity[view] for view in leaders)
    needed = [view for view in leaders if necessity[view] == highest]
    if len(needed) == 1:
        return needed[0], [f"{tie}; {needed[0]} is the more necessary and taken"]
    led = max(present.get(view, 0.0) for view in needed)
    before = [view for view in needed if present.get(view, 0.0) == led]
    why = "for its present share" if len(before) == 1 else "for it is named first"
    return before[0], [
        f"{tie} and are equally necessary; {before[0]} is taken {why}: ask more raters"
    ]


def _shares(votes: Votes, necessity: Means, dominant: str) -> dict[str, float]:
    """The rule's shares; exact fractions until the cut to hundredths."""
    views = list(votes)
    if len(views) == 1:
        return {dominant: 1.0}
    guaranteed, rest = GUARANTEED / len(views), 1 - GUARANTEED
    even = Fraction(1, len(views))
    share_of_votes = Fraction(votes[dominant], sum(votes.values()))
    lead = LEAST_LEAD + (WHOLE - LEAST_LEAD) * (share_of_votes - even) / (1 - even)
    others = {view: mean - LEAST for view, mean in necessity.items() if view != dominant}
    total = sum(others.values())
    left = rest * (1 - lead)
    hundredths = {}
    for view, above in others.items():
        part = above / total if total else Fraction(1, len(others))
        hundredths[view] = floor(HUNDREDTHS * (guaranteed + left * part))
    hundredths[dominant] = HUNDREDTHS - sum(hundredths.values())
    return {view: hundredths[view] / HUNDREDTHS for view in views}


def _disagreement(votes: Votes, necessity: Means, dominant: str) -> list[str]:
    remarks = []
    named, voters = votes[dominant], sum(votes.values())
    if voters > 1 and 2 * named <= voters:
        remarks.append(f"no majority: {named} of {voters} named {dominant} most critical")
    more = [view for view, mean in necessity.items() if mean > necessity[dominant]]
    if more:
        remarks.append(
            f"{dominant} is most often named most critical, but {' and '.join(more)} "
            f"{'is' if len(more) == 1 else 'are'} rated more necessary"
        )
    return remarks


Floats = NDArray[np.float64]

RELIABLE_ALPHA = 0.800  # from here on conclusions may be drawn
TENTATIVE_ALPHA = 0.667  # below it not even tentative ones


def krippendorff_alpha(values: Floats, level: Literal["nominal", "ordinal"]) -> float | None:
    """Alpha of `values`, shape (raters, units), NaN where a rater gave none.

    K. Krippendorff, "Computing Krippendorff's Alpha-Reliability" (2011); "Content Analysis" (2004),
    page 241, for the two bounds.

    1 is perfect agreement, 0 what chance would do; None where it is not defined: no unit has two
    values, or all values are the same.
    """
    values = values[:, np.sum(np.isfinite(values), axis=0) >= 2]
    categories = np.unique(values[np.isfinite(values)])
    if len(categories) < 2:
        return None
    counts = np.sum(values[..., np.newaxis] == categories, axis=0)  # (units, categories)
    pairs = counts[:, :, np.newaxis] * counts[:, np.newaxis] - counts[:, np.newaxis] * np.eye(
        len(categories)
    )
    coincidences = np.sum(pairs / (np.sum(counts, axis=1) - 1)[:, np.newaxis, np.newaxis], axis=0)
    totals = np.sum(counts, axis=0)
    if level == "nominal":
        distances = 1.0 - np.eye(len(categories))
    else:
        ranks = np.cumsum(totals) - totals / 2
        distances = (ranks[:, np.newaxis] - ranks) ** 2
    expected = np.sum(np.outer(totals, totals) * distances)
    return float(1.0 - (np.sum(totals) - 1) * np.sum(coincidences * distances) / expected)


PAPER_RATERS = 8  # the paper's calibration sample


@dataclass(frozen=True, slots=True)
class Assessment:
    """W with its evidence. Alphas are over all phases; None where they are not defined."""

    raters: int
    simulated: int  # how many of them are not people
    rows: dict[Phase, PhaseWeights]
    necessity_alpha: float | None  # ordinal; units are views in phases
    critical_alpha: float | None  # nominal; units are phases
    remarks: tuple[str, ...]  # on the whole panel; each row has its own

    @property
    def matrix(self) -> dict[str, dict[str, float]]:
        """W as the configuration writes it."""
        return {phase.value: dict(row.shares) for phase, row in self.rows.items()}

    @property
    def unfounded(self) -> str:
        """Why the dominant views rest on too little, a sentence without its full stop, or "".

        They make most of W; the necessity divides only what is left.
        """
        alpha = self.critical_alpha
        if alpha is not None and alpha >= TENTATIVE_ALPHA:
            return ""
        return (
            "The raters agree too little on the most critical view to rely on it "
            f"(alpha {known(alpha, '{:.2f}')}, {verdict(alpha)})"
        )

    @property
    def all_remarks(self) -> list[str]:
        """Everything to be wary of, the phase's name before what concerns only one."""
        of_rows = (
            f"{phase.value}: {remark}" for phase, row in self.rows.items() for remark in row.remarks
        )
        return [*self.remarks, *of_rows]


def assess(
    sheets: Sequence[Sheet],
    views: Sequence[str],
    present: Mapping[Phase, Mapping[str, float]],
    more_remarks: Sequence[str] = (),
) -> Assessment:
    """Build W from `sheets` and judge the evidence; `present` is the matrix in force.

    `more_remarks`: what else there is to be wary of.
    """
    necessity = necessity_table(sheets, views)
    raters = len(sheets)
    necessity_alpha = krippendorff_alpha(necessity.reshape(raters, -1), "ordinal")
    critical_alpha = krippendorff_alpha(critical_table(sheets, views), "nominal")
    simulated = sum(sheet.simulated for sheet in sheets)
    remarks = [
        *_size_remarks(raters, simulated),
        *more_remarks,
    ]
    return Assessment(
        raters=raters,
        simulated=simulated,
        rows=fit_weights(sheets, views, present),
        necessity_alpha=necessity_alpha,
        critical_alpha=critical_alpha,
        remarks=tuple(remarks),
    )


def verdict(alpha: float | None) -> str:
    """What Krippendorff's convention says of an alpha."""
    if alpha is None:
        return "not defined"
    if alpha >= RELIABLE_ALPHA:
        return "reliable"
    return "tentative" if alpha >= TENTATIVE_ALPHA else "not reliable"


def _size_remarks(raters: int, simulated: int) -> list[str]:
    remarks = []
    if simulated:
        whose = "all" if simulated == raters else f"{simulated} of {raters}"
        remarks.append(f"{whose} ratings are of a simulated panel, not of people")
    if raters < PAPER_RATERS:
        remarks.append(f"few raters: {raters}, where the paper asked {PAPER_RATERS}")
    return remarks
