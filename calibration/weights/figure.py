"""W as a figure, beside what it was made from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes

from calibration.figures import PALETTE, new_figure, save_figure
from calibration.weights.agreement import RELIABLE_ALPHA, TENTATIVE_ALPHA, Assessment
from calibration.weights.ratings import LEAST, MOST, Sheet, necessity_table
from tams_app.records import Phase

_SMALL_PT, _TEXT_PT = 8, 9
_SPREAD = 0.09  # between the dots of raters with the same answer
_ROWS_IN = 0.62


def save_weights(
    assessment: Assessment, sheets: Sequence[Sheet], views: Sequence[str], path: Path
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
    at: dict[str, Any] = {"loc": "outside lower center", "ncols": len(views), "frameon": False}
    figure.legend(handles, labels, fontsize=_SMALL_PT, **at)
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


def _draw_shares(axes: Axes, assessment: Assessment, views: Sequence[str]) -> None:
    rows = assessment.rows
    matrix = np.array([[rows[phase].shares[view] for view in views] for phase in Phase])
    axes.imshow(matrix, cmap="Blues", vmin=0, vmax=0.8, aspect="auto")
    for (y, x), share in np.ndenumerate(matrix):
        weight = "bold" if views[x] == list(rows.values())[y].dominant else "normal"
        colour = "white" if share > 0.4 else "black"
        how: dict[str, Any] = {"ha": "center", "va": "center", "fontweight": weight}
        axes.text(x, y, f"{share:.2f}", fontsize=_TEXT_PT, color=colour, **how)
    kept = "\n(kept as it was)"
    names = [phase.value + ("" if rows[phase].dominant else kept) for phase in Phase]
    axes.set_xticks(range(len(views)), [view.upper() for view in views])
    axes.set_yticks(range(len(Phase)), names)
    _style(axes, "W: share of the bits")


def _draw_necessity(axes: Axes, sheets: Sequence[Sheet], views: Sequence[str]) -> None:
    """A dot per rater, equal ones beside each other, and a bar at the mean."""
    table = necessity_table(sheets, views)
    for number, view in enumerate(views):
        middle = (number - (len(views) - 1) / 2) * 0.8 / len(views)
        colour = PALETTE[number % len(PALETTE)]
        for y in range(len(Phase)):
            points = np.sort(table[np.isfinite(table[:, y, number]), y, number])
            _, first, counts = np.unique(points, return_index=True, return_counts=True)
            rank = np.arange(len(points)) - np.repeat(first, counts)
            x = points + _SPREAD * (rank - (np.repeat(counts, counts) - 1) / 2)
            label = view.upper() if y == 0 else None
            height = np.full(len(points), y + middle)
            axes.plot(x, height, "o", ms=3.5, alpha=0.75, color=colour, label=label)
            if len(points):
                low, high = y + middle - 0.12, y + middle + 0.12
                axes.vlines(points.mean(), low, high, color="black", linewidth=1.5, zorder=3)
    axes.set_xlim(LEAST - 0.5, MOST + 0.5)
    axes.set_xticks(range(LEAST, MOST + 1))
    axes.grid(axis="x", linewidth=0.5, color="#d9d9d9")
    _style(axes, "necessity: a dot per rater, a bar at the mean")


def _draw_votes(axes: Axes, assessment: Assessment, views: Sequence[str]) -> None:
    left = np.zeros(len(Phase))
    for number, view in enumerate(views):
        counts = np.array([assessment.rows[phase].votes[view] for phase in Phase])
        colour = PALETTE[number % len(PALETTE)]
        bars = axes.barh(range(len(Phase)), counts, left=left, height=0.5, color=colour)
        labels = [str(count) if count else "" for count in counts]
        axes.bar_label(bars, labels, label_type="center", fontsize=_SMALL_PT, color="white")
        left += counts
    axes.set_xlim(0, max(assessment.raters, 1))
    _style(axes, "named most critical by")


def _draw_concordance(axes: Axes, assessment: Assessment) -> None:
    values = [assessment.concordance[phase] for phase in Phase]
    known = [value or 0.0 for value in values]
    bars = axes.barh(range(len(Phase)), known, height=0.3, color="#666666")
    labels = ["not defined" if value is None else f"{value:.2f}" for value in values]
    axes.bar_label(bars, labels, padding=2, fontsize=_SMALL_PT)
    axes.set_xlim(0, 1.3)
    _style(axes, "Kendall's W")


def _style(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=_TEXT_PT)
    axes.tick_params(labelsize=_SMALL_PT)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set_ylim(len(Phase) - 0.5, -0.5)
