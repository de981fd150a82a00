"""What the ratings come to: the matrix, how far the raters agree, and what to be wary of."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from calibration.weights.agreement import (
    RELIABLE_ALPHA,
    TENTATIVE_ALPHA,
    Metric,
    kendall_w,
    krippendorff_alpha,
)
from calibration.weights.fit import PhaseWeights, fit_weights
from calibration.weights.ratings import Sheet, critical_table, necessity_table
from tams_app.records import Phase

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

    def with_remarks(self, remarks: Sequence[str]) -> Assessment:
        """The same with more to be wary of."""
        return replace(self, remarks=(*self.remarks, *remarks))


def assess(
    sheets: Sequence[Sheet],
    views: Sequence[str],
    present: Mapping[Phase, Mapping[str, float]],
) -> Assessment:
    """Build W from `sheets` and judge the evidence; `present` is the matrix in force."""
    necessity = necessity_table(sheets, views)
    raters = len(sheets)
    necessity_alpha = krippendorff_alpha(necessity.reshape(raters, -1), Metric.ORDINAL)
    critical_alpha = krippendorff_alpha(critical_table(sheets, views), Metric.NOMINAL)
    simulated = sum(sheet.simulated for sheet in sheets)
    remarks = [
        *_size_remarks(raters, simulated),
        *_alpha_remarks("the necessity of views", necessity_alpha),
        *_alpha_remarks("the most critical view", critical_alpha),
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
