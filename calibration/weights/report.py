"""What came of the ratings, for a person to read and for the calibration file to keep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from calibration.kit import as_text, table
from calibration.store import Calibration
from calibration.weights.clips import CutSession
from calibration.weights.cutting import LONGEST_S, SHORTEST_S
from calibration.weights.fit import RELIABLE_ALPHA, TENTATIVE_ALPHA, Assessment, verdict
from calibration.weights.ratings import LEAST, MOST, Sheet, necessity_table
from tams_app.palette import view_colour
from tams_app.printing import known
from tams_app.records import Phase
from tams_app.report import plots

KIND = "weights"
_RULE = (
    "most often named most critical: 0.6/V + 0.4 (5/8 .. 1 by its share of the votes); others: "
    "0.6/V and the rest by mean necessity (calibration/weights/fit.py)"
)


def describe(assessment: Assessment, views: Sequence[str]) -> str:
    """W, votes and agreement as a table, and everything to be wary of."""
    rows = [
        (
            phase.value,
            *(f"{row.shares[view]:.2f}{'*' if view == row.dominant else ' '}" for view in views),
            "/".join(str(row.votes[view]) for view in views),
        )
        for phase, row in assessment.rows.items()
    ]
    lines = [as_text(table(rows, ("", *(view.upper() for view in views), "votes")))]
    lines.append("* the dominant view, the one most often named most critical")
    necessity, critical = (
        f"alpha {known(alpha, '{:.2f}')} ({verdict(alpha)})"
        for alpha in (assessment.necessity_alpha, assessment.critical_alpha)
    )
    lines.append(
        f"Agreement over all phases: necessity {necessity}, most critical view {critical}."
    )
    if assessment.all_remarks:
        lines += ["Be wary:", *(f"- {remark}" for remark in assessment.all_remarks)]
    return "\n".join(lines)


def describe_cut(cut: CutSession) -> str:
    """Which clips there are, and of which phases there are none."""
    clips = ", ".join(f"{phase.value} {times.seconds:.1f} s" for phase, times in cut.clips.items())
    missing = [phase.value for phase in Phase if phase not in cut.clips]
    lacking = (
        f" No clip of {', '.join(missing)}: give more sessions, or --context-s 0.5 to see short "
        "phases with what is around them."
        if missing
        else ""
    )
    return (
        f"{len(cut.clips)} clips: {clips}.{lacking} Each is the longest stretch of its phase, of "
        f"{SHORTEST_S:g} to {LONGEST_S:g} s."
    )


def evidence_remarks(
    sheets: Sequence[Sheet], sessions: Mapping[str, CutSession], for_rig: bool
) -> list[str]:
    """Raters who left out phases that others rated, and clips that were not what they stand for.

    `for_rig`: the weights are for the simulated rig, and so may its frames be.
    """
    rated = {answer.phase for sheet in sheets for answer in sheet.answers}
    return [
        *(
            f"{sheet.rater} has rated {len(sheet.answers)} of {len(rated)} phases"
            for sheet in sheets
            if len(sheet.answers) < len(rated)
        ),
        *(
            f"the clips of {name} are {cut.shows}, not at full quality"
            for name, cut in sessions.items()
            if cut.constrained
        ),
        *(
            f"the clips of {name} show the simulated rig, not a real arm"
            for name, cut in sessions.items()
            if cut.rig and not for_rig
        ),
    ]


def calibration_of(
    assessment: Assessment,
    sheets: Sequence[Sheet],
    sessions: Mapping[str, CutSession],
    panel: str | None,
) -> Calibration:
    """The record to keep; `panel`: how simulated raters were made, None if none were made now."""
    return Calibration(
        KIND,
        {"policy": {"weights": {"matrix": assessment.matrix}}},
        _source(assessment, sheets, sessions, panel),
        {
            "raters": [sheet.rater for sheet in sheets],
            "simulated_raters": assessment.simulated,
            "necessity_alpha_ordinal": _rounded(assessment.necessity_alpha),
            "most_critical_alpha_nominal": _rounded(assessment.critical_alpha),
            "by_phase": {phase.value: _phase_quality(assessment, phase) for phase in Phase},
            "remarks": assessment.all_remarks,
            "rule": _RULE,
            "clips": {name: _session_quality(cut) for name, cut in sessions.items()},
        },
        simulated=assessment.simulated > 0,
        unfounded=assessment.unfounded,
    )


def _source(
    assessment: Assessment,
    sheets: Sequence[Sheet],
    sessions: Mapping[str, CutSession],
    panel: str | None,
) -> str:
    people = len(sheets) - assessment.simulated
    parts = [f"ratings of {people} people"] if people else []
    if assessment.simulated:
        how = f" ({panel})" if panel else ""
        parts.append(f"ratings of a simulated panel of {assessment.simulated}{how}, not of people")
    count = sum(len(cut.clips) for cut in sessions.values())
    where = "1 session" if len(sessions) == 1 else f"{len(sessions)} sessions"
    seen = f", on {count} clips of {where}" if sessions else ", on unknown clips"
    return " and ".join(parts) + seen


def _phase_quality(assessment: Assessment, phase: Phase) -> dict[str, Any]:
    row = assessment.rows[phase]
    return {
        "dominant": row.dominant,
        "votes": row.votes,
        "mean_necessity_of_1_to_5": {view: _rounded(mean) for view, mean in row.necessity.items()},
    }


def _session_quality(cut: CutSession) -> dict[str, Any]:
    return {
        "recorded": cut.recorded,
        "picture": cut.shows,
        "simulated_rig": cut.rig,
        "context_s": cut.context_s,
        "seconds": {phase.value: times.seconds for phase, times in cut.clips.items()},
    }


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)


_SPREAD = 0.09  # between the dots of raters with the same answer
_ROWS_IN = 0.62


@plots.styled
def weights_figure(assessment: Assessment, sheets: Sequence[Sheet], views: Sequence[str]) -> Figure:
    """W and the necessity that every rater gave, by phase."""
    figure = plots.new_figure(plots.WIDE_IN, 1.5 + _ROWS_IN * len(Phase))
    shares, necessity = figure.subplots(1, 2, sharey=True, width_ratios=(2.2, 3.2))
    _draw_shares(shares, assessment, views)
    _draw_necessity(necessity, sheets, views)
    figure.suptitle(_title(assessment), fontsize=plots.TEXT_PT)
    plots.legend_beside(figure, necessity, "lower center")
    return figure


def _title(assessment: Assessment) -> str:
    whose = f"{assessment.raters} raters"
    if assessment.simulated:
        whose += f", {assessment.simulated} of them simulated: not people"
    alphas = (assessment.necessity_alpha, assessment.critical_alpha)
    first, second = (known(alpha, "{:.2f}") for alpha in alphas)
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
        how: plots.Style = {"ha": "center", "va": "center", "fontweight": weight}
        axes.text(x, y, f"{share:.2f}", color=colour, **how)
    kept = "\n(kept as it was)"
    names = [phase.value + ("" if rows[phase].dominant else kept) for phase in Phase]
    axes.set_xticks(range(len(views)), [view.upper() for view in views])
    axes.set_yticks(range(len(Phase)), names)
    _style(axes, "W: share of the bits")


def _draw_necessity(axes: Axes, sheets: Sequence[Sheet], views: Sequence[str]) -> None:
    """A dot per rater, equal ones beside each other, and a bar at the mean."""
    given = necessity_table(sheets, views)
    for number, view in enumerate(views):
        middle = (number - (len(views) - 1) / 2) * 0.8 / len(views)
        colour = view_colour(number)
        for y in range(len(Phase)):
            points = np.sort(given[np.isfinite(given[:, y, number]), y, number])
            _, first, counts = np.unique(points, return_index=True, return_counts=True)
            rank = np.arange(len(points)) - np.repeat(first, counts)
            x = points + _SPREAD * (rank - (np.repeat(counts, counts) - 1) / 2)
            label = view.upper() if y == 0 else None
            height = np.full(len(points), y + middle)
            axes.plot(x, height, "o", ms=3.5, alpha=0.75, color=colour, label=label)
            if len(points):
                low, high = y + middle - 0.12, y + middle + 0.12
                axes.vlines(points.mean(), low, high, color=plots.INK, linewidth=1.5, zorder=3)
    axes.set_xlim(LEAST - 0.5, MOST + 0.5)
    axes.set_xticks(range(LEAST, MOST + 1))
    axes.grid(axis="x")
    _style(axes, "necessity: a dot per rater, a bar at the mean")


def _style(axes: Axes, title: str) -> None:
    axes.set_title(title, fontsize=plots.TEXT_PT)
    axes.set_ylim(len(Phase) - 0.5, -0.5)
