"""The tidy tables: one row per trial, and one per trial and phase; Parquet and CSV.

Units are in the column names: _s, _ms, _kbps, _fraction, _ssim, _count; the others have none.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib import import_module
from pathlib import Path
from typing import Any, TypeAlias

from tams_app.errors import LogError
from tams_app.study.plan import AttemptState
from tams_app.study.results import SSIM_KINDS, StudyData, TrialResult

Cell: TypeAlias = str | int | float | bool | None
Row: TypeAlias = dict[str, Cell]

TRIALS_TABLE = "trials"
PHASES_TABLE = "phases"

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
_DAMAGE = {
    "damaged_fraction": "damaged_fraction",
    "undamaged_received_ssim": "undamaged_received_ssim",
    "packets_per_frame_count": "packets_per_frame",
}


def trial_rows(data: StudyData) -> list[Row]:
    """One row per finished trial, practice included and marked."""
    everyone = sorted((*data.results, *data.practice), key=lambda one: one.trial.id)
    return [_trial_row(one, data) for one in everyone]


def phase_rows(data: StudyData) -> list[Row]:
    """One row per finished trial and phase in which the primary view was scored."""
    return [row for one in data.results for row in _phase_rows(one)]


def write_tables(data: StudyData, directory: Path) -> list[Path]:
    """trials.csv, trials.parquet, phases.csv, phases.parquet; LogError where they cannot be."""
    pandas: Any = import_module("pandas")

    written = []
    try:
        directory.mkdir(parents=True, exist_ok=True)
        tables = {TRIALS_TABLE: trial_rows(data), PHASES_TABLE: phase_rows(data)}
        for name, rows in tables.items():
            frame = pandas.DataFrame(rows).convert_dtypes()
            paths = [directory / f"{name}.csv", directory / f"{name}.parquet"]
            frame.to_csv(paths[0], index=False)
            frame.to_parquet(paths[1], index=False)
            written += paths
    except OSError as error:
        raise LogError(f"{directory}: the tables cannot be written: {error.strerror}") from error
    return written


def _trial_row(result: TrialResult, data: StudyData) -> Row:
    trial, summary = result.trial, result.summary
    row = _key(result) | {
        "order": trial.order,
        "practice": trial.practice,
        "simulated": data.plan.simulated,
        "seed": trial.seed,
        "participant_seed": trial.participant_seed,
        "void_attempts_count": sum(one.state is AttemptState.VOID for one in trial.attempts),
        "completed": result.completed,
        "success": result.success,
        "completion_time_s": result.completed_time_s,
        "censored_time_s": result.censored_time_s(data.limit_s),
        "drops_count": result.drops,
        "stops_count": len(value_at(summary, "arm.stops") or ()),
        "missing_phases": " ".join(value_at(summary, "primary_view.missing_phases") or ()),
        "processor": result.machine.get("processor"),
    }
    row |= {f"primary_{kind}": result.primary_ssim(kind) for kind in SSIM_KINDS}
    row |= {column: _number(value_at(summary, path)) for column, path in _SESSION.items()}
    for view in data.config.video.views:
        values = summary.get("views", {}).get(view) or {}
        row |= {
            f"{view}_{column}": _number(value_at(values, path)) for column, path in _VIEW.items()
        }
    return row


def _phase_rows(result: TrialResult) -> list[Row]:
    by_phase = (result.summary.get("primary_view") or {}).get("by_phase", {})
    rows = []
    for phase, scores in by_phase.items():
        lasted_s = result.phase_seconds.get(phase)
        row = _key(result) | {"phase": phase, "duration_s": lasted_s and round(lasted_s, 4)}
        row |= {kind: _number(scores.get(kind)) for kind in SSIM_KINDS}
        row |= {column: _number(scores.get(key)) for column, key in _DAMAGE.items()}
        row |= {f"{kind}_count": _number(value_at(scores, f"n.{kind}")) for kind in SSIM_KINDS}
        shares = result.relied_on.get(phase, {})
        row |= {f"relied_on_{view}_fraction": share for view, share in shares.items()}
        rows.append(row)
    return rows


def _key(result: TrialResult) -> Row:
    return {
        "trial": result.trial.id,
        "participant": result.participant,
        "strategy": result.strategy,
        "network": result.network,
        "repetition": result.trial.repetition,
    }


def value_at(tree: Mapping[str, Any], path: str) -> Any:
    """The value at a dotted path, None where a part of it is missing."""
    node: Any = tree
    for part in path.split("."):
        if not isinstance(node, Mapping):
            return None
        node = node.get(part)
    return node


def _number(value: Any) -> Cell:
    """Simple values as they are; what has no place in a cell is left out."""
    return value if isinstance(value, str | int | float | bool) else None
