"""What came of the ratings, for a person to read and for the calibration file to keep."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from calibration.store import Calibration
from calibration.weights.agreement import Assessment, verdict
from calibration.weights.clips import CutSession
from calibration.weights.cutting import LONGEST_S, SHORTEST_S
from calibration.weights.ratings import Sheet
from tams_app.records import Phase

KIND = "weights"
_RULE = (
    "most often named most critical: 0.6/V + 0.4 (5/8 .. 1 by its share of the votes); others: "
    "0.6/V and the rest by mean necessity (calibration/weights/fit.py)"
)


def describe(assessment: Assessment, views: Sequence[str]) -> str:
    """W, votes and agreement as a table, and everything to be wary of."""
    heads = "".join(f"{view.upper():>7}" for view in views)
    lines = [f"{'':13}{heads}   votes   Kendall's W of the necessities"]
    for phase, row in assessment.rows.items():
        shares = "".join(
            f"{row.shares[view]:>6.2f}{'*' if view == row.dominant else ' '}" for view in views
        )
        votes = "/".join(str(row.votes[view]) for view in views)
        lines.append(
            f"{phase.value:13}{shares}   {votes:7} {_number(assessment.concordance[phase])}"
        )
    lines.append("* the dominant view, the one most often named most critical")
    lines += [
        f"Agreement over all phases: necessity alpha {_number(assessment.necessity_alpha)} "
        f"({verdict(assessment.necessity_alpha)}), most critical view alpha "
        f"{_number(assessment.critical_alpha)} ({verdict(assessment.critical_alpha)}).",
    ]
    if assessment.all_remarks:
        lines += ["Be wary:", *(f"- {remark}" for remark in assessment.all_remarks)]
    return "\n".join(lines)


def describe_cut(cut: CutSession) -> str:
    """Which clips there are, and what was left out."""
    clips = ", ".join(f"{phase.value} {times.seconds:.1f} s" for phase, times in cut.clips.items())
    missing = [phase.value for phase in Phase if phase not in cut.clips]
    lacking = (
        f" No clip of {', '.join(missing)}: give more sessions, or --context-s 0.5 to see short "
        "phases with what is around them."
        if missing
        else ""
    )
    return (
        f"{len(cut.clips)} clips: {clips}.{lacking} Left out: {cut.too_short} stretches under "
        f"{SHORTEST_S:g} s and {cut.not_longest} that were not the longest of their phase "
        f"(a clip is at most {LONGEST_S:g} s)."
    )


def evidence_remarks(
    sheets: Sequence[Sheet], sessions: Mapping[str, CutSession], for_rig: bool
) -> list[str]:
    """Raters who left out phases that others rated, and clips that were not what they stand for.

    `for_rig`: the weights are for the simulated rig, and so may its frames be.
    """
    rated = {answer.phase for sheet in sheets for answer in sheet.answers}
    incomplete = [
        f"{sheet.rater} has rated {len(sheet.answers)} of {len(rated)} phases"
        for sheet in sheets
        if len(sheet.answers) < len(rated)
    ]
    constrained = [
        f"the clips of {name} are {cut.shows}, not at full quality"
        for name, cut in sessions.items()
        if cut.constrained
    ]
    drawn = [
        f"the clips of {name} show the simulated rig, not a real arm"
        for name, cut in sessions.items()
        if cut.rig and not for_rig
    ]
    return incomplete + constrained + drawn


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
        "kendall_w": _rounded(assessment.concordance[phase]),
    }


def _session_quality(cut: CutSession) -> dict[str, Any]:
    return {
        "recorded": cut.recorded,
        "picture": cut.shows,
        "simulated_rig": cut.rig,
        "context_s": cut.context_s,
        "seconds": {phase.value: times.seconds for phase, times in cut.clips.items()},
    }


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.2f}"


def _rounded(value: float | None) -> float | None:
    return None if value is None else round(value, 3)
