"""What the operator was shown: glances of a simulated one, frames, and the predicted arm."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tams_app.recording import SessionLog
from tams_app.records import HandHeard, MountPrediction, OperatorGlance, Phase, Pose, StateHeard
from tams_app.summary.tables import (
    Flags,
    Floats,
    Number,
    percentiles,
    phase_at,
    primary_at,
    ratio,
)
from tams_app.units import NS_PER_MS, NS_PER_S

_MOVED_M = 0.002  # since the newest state: else there is nothing to predict
LINK_NAMES = ("p50", "p95", "p99", "max")  # of the percentiles
_NAMES = ("p50", "p95")


def operator(log: SessionLog) -> dict[str, Any]:
    """All is null where there was none, as with people.

    `kind`: seeing, scripted or recorded. `glances_per_s`: from the first glance to the last.
    `relied_on`: `by_phase` is the mean share of each view over the glances in that phase which
    showed something, `n` of them; `agreement` the fraction of these glances in which the view that
    showed most was the phase's primary view (argmax W). `uncertainty_mm`: by stage of the task, one
    standard deviation of the distance to the goal (block, then container), as they judged it.
    """
    looked = bool(log.glances)
    return {
        "kind": log.facts.get("operator"),
        "glances_per_s": _glances_per_s(log.glances),
        "relied_on": _relied_on(log) if looked else None,
        "uncertainty_mm": _uncertainty_mm(log.glances) if looked else None,
    }


def seen(log: SessionLog) -> dict[str, Any] | None:
    """What the operator's log alone tells of link and frames shown; None of any other log."""
    if not log.states_received or log.ticks:
        return None
    seconds = max(log.ended_ns - log.header.started_ns, 1) / NS_PER_S
    frames = {view: sum(one.view == view for one in log.shown) for view in log.header.views}
    heard_ns = np.array([one.t_ns for one in log.states_received])
    gaps_ms = np.diff(heard_ns) / NS_PER_MS
    return {
        "round_trip_ms": round_trip_ms(log.states_received),
        "messages": len(heard_ns),
        "longest_gap_ms": percentiles(gaps_ms, ("max",))["max"],
        "shown": {
            view: {"frames": number, "per_s": round(number / seconds, 2)}
            for view, number in frames.items()
        },
    }


def round_trip_ms(received: Sequence[HandHeard | StateHeard]) -> dict[str, Number]:
    """By the stamps of one's own that came back."""
    trips_ns = [one.t_ns - one.echo_ns for one in received if one.echo_ns > 0]
    return percentiles(np.array(trips_ns) / NS_PER_MS, LINK_NAMES)


def _glances_per_s(glances: list[OperatorGlance]) -> float | None:
    """None of fewer than two."""
    span_ns = glances[-1].t_ns - glances[0].t_ns if glances else 0
    return round((len(glances) - 1) * NS_PER_S / span_ns, 2) if span_ns > 0 else None


def _relied_on(log: SessionLog) -> dict[str, Any]:
    found = _glances_by_phase(log)
    looked = [glance for glances in found.values() for glance in glances]
    primary = primary_at(log, np.array([glance.t_ns for glance in looked], dtype=np.int64))
    agreeing = sum(
        log.header.views.index(max(glance.relied_on, key=glance.relied_on.__getitem__)) == place
        for glance, place in zip(looked, primary, strict=True)
    )
    return {
        "by_phase": {
            phase.value: _mean_shares(glances, log.header.views) for phase, glances in found.items()
        },
        "n": {phase.value: len(glances) for phase, glances in found.items()},
        "agreement": ratio(agreeing, sum(map(len, found.values()))),
    }


def _uncertainty_mm(glances: list[OperatorGlance]) -> dict[str, Any]:
    by_stage: dict[str, list[float]] = {}
    for glance in glances:
        by_stage.setdefault(glance.stage, []).append(1e3 * glance.sigma)
    return {
        stage: {**percentiles(np.array(found), _NAMES), "n": len(found)}
        for stage, found in by_stage.items()
    }


def _glances_by_phase(log: SessionLog) -> dict[Phase, list[OperatorGlance]]:
    """The glances that showed something, by the phase at their time; the rest are left out."""
    numbers = phase_at(log, np.array([one.t_ns for one in log.glances], dtype=np.int64))
    informative = [
        (number, one) for number, one in zip(numbers, log.glances, strict=True) if one.relied_on
    ]
    found = {phase: [one for at, one in informative if at == n] for n, phase in enumerate(Phase)}
    return {phase: glances for phase, glances in found.items() if glances}


def _mean_shares(glances: list[OperatorGlance], views: tuple[str, ...]) -> dict[str, float]:
    return {
        view: round(float(np.mean([one.relied_on.get(view, 0.0) for one in glances])), 4)
        for view in views
    }


def prediction_errors(log: SessionLog) -> dict[str, Any]:
    """The entry `prediction` of summary.json; all null where nothing was predicted.

    Errors are of the flange, of predictions for times at which its pose became known later, while
    it had moved by more than 2 mm since the newest state.
    """
    made = log.predictions
    error_mm, newest_mm, error_deg = _counted_errors(made) if made else (np.empty(0),) * 3
    return {
        "error_mm": percentiles(error_mm, _NAMES),
        "error_deg": percentiles(error_deg, _NAMES),
        "newest_state_mm": percentiles(newest_mm, _NAMES),
        "trusted_fraction": ratio(sum(one.trusted for one in made), len(made)),
        "camera_fits": all(one.camera_fits for one in made) if made else None,
    }


def _counted_errors(predictions: list[MountPrediction]) -> tuple[Floats, Floats, Floats]:
    """Of the predictions that count: their error, and what the newest state was off by."""
    states = {one.then_ns: one.then for one in predictions}
    times_ns = np.array(sorted(states), dtype=np.int64)
    known = _pose_rows([states[t_ns] for t_ns in times_ns.tolist()])
    predicted = _pose_rows([one.now for one in predictions])
    newest = _pose_rows([one.then for one in predictions])
    at_ns = np.array([one.now_ns + one.offset_ns for one in predictions], dtype=np.int64)
    since_ns = at_ns - times_ns[0]
    true = np.stack(
        [np.interp(since_ns, times_ns - times_ns[0], column) for column in known.T], axis=1
    )
    newest_m = np.linalg.norm((newest - true)[:, :3], axis=1)
    counts: Flags = (at_ns <= times_ns[-1]) & (newest_m > _MOVED_M)
    error_m = np.linalg.norm((predicted - true)[:, :3], axis=1)
    turn_rad = _angles(predicted[:, 3:], true[:, 3:])
    return error_m[counts] * 1e3, newest_m[counts] * 1e3, np.degrees(turn_rad[counts])


def _pose_rows(poses: list[Pose]) -> NDArray[np.float64]:
    """Position [m] and quaternion, of the two the one nearer to that before, shape (n, 7)."""
    rows = np.array([(*pose.position, *pose.rotation) for pose in poses])
    cosines = (rows[1:, 3:] * rows[:-1, 3:]).sum(axis=1)
    rows[1:, 3:] *= np.cumprod(np.where(cosines < 0.0, -1.0, 1.0))[:, None]
    return rows


def _angles(one: NDArray[np.float64], other: NDArray[np.float64]) -> Floats:
    """Between the rotations of quaternions, shape (n, 4) [rad]."""
    cosines = np.abs((one * other).sum(axis=1)) / np.linalg.norm(other, axis=1)
    angles: Floats = 2.0 * np.arccos(np.clip(cosines, 0.0, 1.0))
    return angles
