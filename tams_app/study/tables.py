"""The rows of the tidy tables: one per trial, and one per trial and phase, from summary.json.

Units are in the column names: _s, _ms, _mm, _kbps, _fraction, _ssim, _count; others have none.
"""

from __future__ import annotations

from collections.abc import Mapping
from itertools import pairwise
from typing import Any, TypeAlias

from tams_app.config import Config
from tams_app.records import Phase
from tams_app.study.plan import AttemptState, PlannedTrial
from tams_app.summary.quality import SSIM_KINDS

Cell: TypeAlias = str | int | float | bool | None
Row: TypeAlias = dict[str, Cell]

PHASES = tuple(phase.value for phase in Phase)
TRIAL_KEY = ("trial", "participant", "strategy", "network", "repetition")  # begins every row

# column -> where it is in summary.json
_SESSION: dict[str, str] = {
    "duration_s": "duration_s",
    "version": "version",
    "budget_mode": "budget_mode",
    "primary_time_weighted_received_ssim": "primary_view.time_weighted.received_ssim",
    "uplink_capacity_kbps": "uplink.capacity_kbps",
    "uplink_budget_kbps": "uplink.budget_kbps_mean",
    "uplink_sent_kbps": "uplink.sent_kbps_mean",
    "uplink_utilisation_fraction": "uplink.utilisation",
    "uplink_queue_p50_ms": "uplink.queue_ms.p50",
    "uplink_queue_p95_ms": "uplink.queue_ms.p95",
    "uplink_loss_fraction": "uplink.loss_fraction",
    "uplink_residual_loss_fraction": "uplink.residual_loss_fraction",
    "control_late_fraction": "control.late_fraction",
    "app_cpu_percent": "system.cpu_percent.app",
    "peak_rss_mb": "system.peak_rss_mb",
}
_VIEW: dict[str, str] = {
    "target_kbps": "target_kbps_mean",
    "sent_kbps": "sent_kbps_mean",
    "tracking_error_fraction": "tracking_error",
    "frames_captured_count": "frames_captured",
    "frames_sent_count": "frames_sent",
    "frames_shown_count": "frames_shown",
    "frames_damaged_count": "frames_damaged",
    "latency_p50_ms": "latency_ms.p50",
    "latency_p95_ms": "latency_ms.p95",
    "freezes_count": "freezes.count",
    "freezes_total_s": "freezes.total_s",
    "freezes_longest_s": "freezes.longest_s",
    **{kind: kind for kind in SSIM_KINDS},
}

# column -> key in a phase's scores
PHASE_SCORES: dict[str, str] = {
    **{kind: kind for kind in SSIM_KINDS},
    "damaged_fraction": "damaged_fraction",
    "undamaged_received_ssim": "undamaged_received_ssim",
    "packets_per_frame_count": "packets_per_frame",
}
_PHASE = PHASE_SCORES | {f"{kind}_count": f"n.{kind}" for kind in SSIM_KINDS}


def trial_row(
    trial: PlannedTrial, summary: Mapping[str, Any], processor: str | None, config: Config
) -> Row:
    """One finished trial. The experimenter's verdict stands before the simulator's."""
    verdict = trial.last.verdict if trial.last else None
    outcome = verdict.model_dump() if verdict else summary["outcome"]
    completed, time_s = outcome["completed"], outcome["completion_time_s"]
    row = _key(trial) | {
        "order": trial.order,
        "practice": trial.practice,
        "simulated": config.rig.enabled,
        "seed": trial.seed,
        "participant_seed": trial.participant_seed,
        "void_attempts_count": sum(one.state is AttemptState.VOID for one in trial.attempts),
        "completed": completed,
        "success": outcome["success"],
        "completion_time_s": time_s if completed else None,
        "censored_time_s": _censored_s(completed, time_s, config.trial.limit_s),
        "drops_count": outcome["drops"],
        "stops_count": len(_value_at(summary, "arm.stops") or ()),
        "missing_phases": " ".join(_value_at(summary, "primary_view.missing_phases") or ()),
        "processor": processor,
    }
    primary = _value_at(summary, "primary_view") or {}
    row |= {f"primary_{kind}": _cell(primary, kind) for kind in SSIM_KINDS}
    row |= {column: _cell(summary, path) for column, path in _SESSION.items()}
    for view in config.video.views:
        values = _value_at(summary, f"views.{view}") or {}
        row |= {f"{view}_{column}": _cell(values, path) for column, path in _VIEW.items()}
    row["glance_agreement_fraction"] = _cell(summary, "operator.relied_on.agreement")
    stages = _value_at(summary, "operator.uncertainty_mm") or {}
    return row | {f"uncertainty_{stage}_mm": _cell(one, "p50") for stage, one in stages.items()}


def phase_rows(trial: PlannedTrial, summary: Mapping[str, Any]) -> list[Row]:
    """The phases that a trial went through; scores are empty where no frame was scored."""
    lasted_s = _phase_seconds(summary)
    scored = _value_at(summary, "primary_view.by_phase") or {}
    relied_on = _value_at(summary, "operator.relied_on.by_phase") or {}
    rows = []
    for phase in PHASES:
        if phase not in lasted_s and phase not in scored and phase not in relied_on:
            continue
        scores = scored.get(phase) or {}
        row = _key(trial) | {"phase": phase, "duration_s": lasted_s.get(phase)}
        row |= {column: _cell(scores, path) for column, path in _PHASE.items()}
        shares = relied_on.get(phase) or {}
        rows.append(row | {f"relied_on_{view}_fraction": one for view, one in shares.items()})
    return rows


def _key(trial: PlannedTrial) -> Row:
    return {"trial": trial.id, **{name: getattr(trial, name) for name in TRIAL_KEY[1:]}}


def _censored_s(completed: bool | None, time_s: float | None, limit_s: float) -> float | None:
    """The completion time, the limit where the block was not placed; None if not judged."""
    if completed and time_s is not None:
        return min(time_s, limit_s)
    return limit_s if completed is False else None


def _phase_seconds(summary: Mapping[str, Any]) -> dict[str, float]:
    """The total time of each phase [s]."""
    changes = summary.get("phases") or []
    found: dict[str, float] = {}
    for change, later in pairwise((*changes, {"t_s": summary.get("duration_s")})):
        found[change["phase"]] = found.get(change["phase"], 0.0) + later["t_s"] - change["t_s"]
    return {phase: round(seconds, 4) for phase, seconds in found.items()}


def _value_at(tree: Mapping[str, Any], path: str) -> Any:
    """The value at a dotted path, None where a part of it is missing."""
    node: Any = tree
    for part in path.split("."):
        if not isinstance(node, Mapping):
            return None
        node = node.get(part)
    return node


def _cell(tree: Mapping[str, Any], path: str) -> Cell:
    """A simple value as it is, None for what has no place in a cell."""
    value = _value_at(tree, path)
    return value if isinstance(value, str | int | float | bool) else None
