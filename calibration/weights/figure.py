"""W as a figure, beside what it was made from."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from calibration.figures import PALETTE, new_figure, save_figure
from calibration.weights.agreement import RELIABLE_ALPHA, TENTATIVE_ALPHA, Assessment
from calibration.weights.ratings import LEAST, MOST, Sheet, necessity_table
from tams_app.records import Phase

_SMALL_PT, _TEXT_PT = 8, 9
_SPREAD = 0.09  # between the dots of raters who said the same
_ROWS_IN = 0.62


def save_weights(
    assessment: Assessment, sheets: list[Sheet], views: tuple[str, ...], path: Path
) -> None:
    """W, the necessity every rater gave, the votes and Kendall's W by phase, drawn to a file."""
    figure = new_figure(11, 1.5 + _ROWS_IN * len(Phase))
    shares, necessity, votes, concordance = figure.subplots(
        1, 4, sharey=True, width_ratios=(2.2, 3.2, 2.2, 1.4)
    )
    _draw_shares(shares, assessment, views)
    _draw_necessity(necessity, sheets, views)
    _draw_votes(votes, assessment, views)
    _draw_concordance(concordance, assessment)
    figure.suptitle(_title(assessment), fontsize=_TEXT_PT)
    handles, labels = necessity.get_legend_handles_labels()
    figure.legend(
        handles,
        labels,
        loc="outside lower center",
        ncols=len(views),
        fontsize=_SMALL_PT,
        frameon=False,
    )
    save_figure(figure, path, dpi=110)


def _title(assessment: Assessment) -> str:
    whose = f"{assessment.raters} raters"
    if assessment.simulated:
        whose += f", {assessment.simulated} of them simulated: not people"
    alphas = (assessment.necessity_alpha, assessment.critical_alpha)
    first, second = ("–" if alpha is None else f"{alpha:.2f}" for alpha in alphas)
    return (
        f"{whose}. Krippendorff's alpha: necessity {first} (ordinal), most critical view {second} "
        f"(nominal); {RELIABLE_ALPHA:.3f} is reliable, below {TENTATIVE_ALPHA} is not"
    )


def _draw_shares(axes: Axes, assessment: Assessment, views: tuple[str, ...]) -> None:
    rows = [assessment.rows[phase] for phase in Phase]
    matrix = np.array([[row.shares[view] for view in views] for row in rows])
    axes.imshow(matrix, cmap="Blues", vmin=0, vmax=0.8, aspect="auto")
    for y, row in enumerate(rows):
        for x, view in enumerate(views):
            heavy = "bold" if view == row.dominant else "normal"
            axes.text(
                x,
                y,
                f"{row.shares[view]:.2f}",
                ha="center",
                va="center",
                fontsize=_TEXT_PT,
                fontweight=heavy,
                color="white" if row.shares[view] > 0.4 else "black",
            )
    kept = {phase: assessment.rows[phase].dominant is None for phase in Phase}
    axes.set_xticks(range(len(views)), [view.upper() for view in views])
    axes.set_yticks(
        range(len(Phase)),
        [f"{phase.value}\n(kept as it was)" if kept[phase] else phase.value for phase in Phase],
    )
    _dress(axes, "W: share of the bits")


def _draw_necessity(axes: Axes, sheets: list[Sheet], views: tuple[str, ...]) -> None:
    """A dot per rater, equal ones beside each other, and a bar at the mean."""
    table = necessity_table(sheets, views)
    for number, view in enumerate(views):
        middle = (number - (len(views) - 1) / 2) * 0.8 / len(views)
        for y in range(len(Phase)):
            points = np.sort(table[np.isfinite(table[:, y, number]), y, number])
            shifts = [
                _SPREAD * (np.sum(points[:place] == point) - (np.sum(points == point) - 1) / 2)
                for place, point in enumerate(points)
            ]
            label = view.upper() if y == 0 else None
            axes.plot(
                points + shifts,
                np.full(len(points), y + middle),
                "o",
                ms=3.5,
                alpha=0.75,
                color=PALETTE[number % len(PALETTE)],
                label=label,
            )
            if len(points):
                axes.plot(
                    [points.mean()] * 2,
                    [y + middle - 0.12, y + middle + 0.12],
                    color="black",
                    linewidth=1.5,
                )
    axes.set_xlim(LEAST - 0.5, MOST + 0.5)
    axes.set_xticks(range(LEAST, MOST + 1))
    axes.grid(axis="x", linewidth=0.5, color="#d9d9d9")
    _dress(axes, "necessity: a dot per rater, a bar at the mean")


def _draw_votes(axes: Axes, assessment: Assessment, views: tuple[str, ...]) -> None:
    for y, phase in enumerate(Phase):
        left = 0
        for number, view in enumerate(views):
            count = assessment.rows[phase].votes[view]
            axes.barh(y, count, left=left, height=0.5, color=PALETTE[number % len(PALETTE)])
            if count:
                axes.text(
                    left + count / 2,
                    y,
                    str(count),
                    ha="center",
                    va="center",
                    fontsize=_SMALL_PT,
                    color="white",
                )
            left += count
    axes.set_xlim(0, max(assessment.raters, 1))
    _dress(axes, "named most critical by")


def _draw_concordance(axes: Axes, assessment: Assessment) -> None:
    for y, phase in enumerate(Phase):
        value = assessment.concordance[phase]
        if value is None:
            axes.text(0.05, y, "not defined", va="center", fontsize=_SMALL_PT)
            continue
        axes.barh(y, value, height=0.3, color="#666666")
        axes.text(min(value + 0.04, 0.7), y - 0.28, f"{value:.2f}", va="center", fontsize=_SMALL_PT)
    axes.set_xlim(0, 1)
    _dress(axes, "Kendall's W")


def _dress(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=_TEXT_PT)
    axes.tick_params(labelsize=_SMALL_PT)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_ylim(len(Phase) - 0.5, -0.5)
