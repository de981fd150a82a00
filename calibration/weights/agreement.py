"""How far raters agree, and what their ratings come to: W with its evidence.

Sources: K. Krippendorff, "Computing Krippendorff's Alpha-Reliability" (2011) and "Content
Analysis" (2004), page 241, for the two bounds; S. Siegel, "Nonparametric Statistics" (1956),
chapter 9, for Kendall's W with its correction for ties.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import krippendorff
import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

from calibration.weights.fit import PhaseWeights, fit_weights
from calibration.weights.ratings import Sheet, critical_table, necessity_table
from tams_app.records import Phase

Floats = NDArray[np.float64]

RELIABLE_ALPHA = 0.800  # from here on conclusions may be drawn
TENTATIVE_ALPHA = 0.667  # below it not even tentative ones


def krippendorff_alpha(values: Floats, level: Literal["nominal", "ordinal"]) -> float | None:
    """Alpha of `values`, shape (raters, units), NaN where a rater gave none.

    1 is perfect agreement, 0 what chance would do; None where it is not defined: no unit has two
    values, or all values are the same.
    """
    values = values[:, np.sum(np.isfinite(values), axis=0) >= 2]
    if len(np.unique(values[np.isfinite(values)])) < 2:
        return None
    return float(krippendorff.alpha(reliability_data=values, level_of_measurement=level))


def kendall_w(values: Floats) -> float | None:
    """Kendall's coefficient of concordance of `values`, shape (raters, things), ties corrected.

    0 is no concordance, 1 the same order by all. Raters with a NaN are left out; None with fewer
    than two raters or two things, or if no rater distinguishes any.
    """
    complete = values[np.all(np.isfinite(values), axis=1)]
    raters, things = complete.shape
    if raters < 2 or things < 2:
        return None
    ranks = np.apply_along_axis(rankdata, 1, complete)
    sums = ranks.sum(axis=0)
    deviation = float(np.sum((sums - sums.mean()) ** 2))
    largest = (raters**2 * (things**3 - things) - raters * sum(map(_ties, ranks))) / 12
    return deviation / largest if largest > 0 else None


def _ties(ranks: Floats) -> int:
    """The sum of t³ − t over one rater's groups of t equal ranks."""
    _, sizes = np.unique(ranks, return_counts=True)
    return int(np.sum(sizes**3 - sizes))


PAPER_RATERS = 8  # the paper's calibration sample


@dataclass(frozen=True, slots=True)
class Assessment:
    """W with its evidence. Alphas are over all phases; None where they are not defined.

    `concordance`: Kendall's W of the views' necessity within each phase.
    """

    raters: int
    simulated: int  # how many of them are not people
    rows: dict[Phase, PhaseWeights]
    necessity_alpha: float | None  # ordinal; units are views in phases
    critical_alpha: float | None  # nominal; units are phases
    concordance: dict[Phase, float | None]
    remarks: tuple[str, ...]  # on the whole panel; each row has its own

    @property
    def matrix(self) -> dict[str, dict[str, float]]:
        """W as the configuration writes it."""
        return {phase.value: dict(row.shares) for phase, row in self.rows.items()}

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
        *_alpha_remarks("the necessity of views", necessity_alpha),
        *_alpha_remarks("the most critical view", critical_alpha),
        *more_remarks,
    ]
    return Assessment(
        raters=raters,
        simulated=simulated,
        rows=fit_weights(sheets, views, present),
        necessity_alpha=necessity_alpha,
        critical_alpha=critical_alpha,
        concordance={
            phase: kendall_w(necessity[:, number, :]) for number, phase in enumerate(Phase)
        },
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


def _alpha_remarks(about: str, alpha: float | None) -> list[str]:
    if alpha is None:
        return [f"agreement on {about} is not defined: too few ratings, or all the same"]
    if alpha >= RELIABLE_ALPHA:
        return []
    bound = (
        f"between {TENTATIVE_ALPHA} and {RELIABLE_ALPHA}: tentative conclusions only"
        if alpha >= TENTATIVE_ALPHA
        else f"below {TENTATIVE_ALPHA}: too little to rely on"
    )
    return [f"agreement on {about}: alpha {alpha:.2f}, {bound}"]
