"""The simulated operator's figures: who, how often they looked, where, and how uncertain."""

from __future__ import annotations

from typing import Any

import numpy as np

from tams_app.recording import SessionLog
from tams_app.records import OperatorGlance, Phase
from tams_app.summary.tables import percentiles, phase_at, primary_at, ratio
from tams_app.units import NS_PER_MS, NS_PER_S


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
    trips_ns = [one.t_ns - one.echo_ns for one in log.states_received if one.echo_ns > 0]
    gaps_ms = np.diff(heard_ns) / NS_PER_MS
    return {
        "round_trip_ms": percentiles(np.array(trips_ns) / NS_PER_MS, ("p50", "p95", "p99", "max")),
        "messages": len(heard_ns),
        "longest_gap_ms": percentiles(gaps_ms, ("max",))["max"],
        "shown": {
            view: {"frames": number, "per_s": round(number / seconds, 2)}
            for view, number in frames.items()
        },
    }


def _glances_per_s(glances: list[OperatorGlance]) -> float | None:
    """None of fewer than two."""
    span_ns = glances[-1].t_ns - glances[0].t_ns if glances else 0
    return round((len(glances) - 1) * NS_PER_S / span_ns, 2) if span_ns > 0 else None


def _relied_on(log: SessionLog) -> dict[str, Any]:
    found = _glances_by_phase(log)
    looked = [glance for glances in found.values() for glance in glances]
    primary = primary_at(log, np.array([glance.t_ns for glance in looked], dtype=np.int64))
    agreeing = sum(
        log.header.views.index(max(glance.relied_on, key=lambda view: glance.relied_on[view]))
        == place
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
        stage: {**percentiles(np.array(found), ("p50", "p95")), "n": len(found)}
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
