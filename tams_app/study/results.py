"""The results of a study as two tables: of its trials, and of each trial's phases.

Their rows are made of summary.json, or read again from exported tables. Units are in the column
names: _s, _ms, _mm, _kbps, _fraction, _ssim, _count; others have none.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from operator import attrgetter
from pathlib import Path
from typing import Any, TypeAlias

import pandas as pd

from tams_app.config import Config
from tams_app.errors import ConfigError
from tams_app.outputs import made_folder, new_file
from tams_app.policy.weights import WeightMatrix
from tams_app.records import Phase
from tams_app.study.folder import StudyFolder
from tams_app.study.plan import Attempt, AttemptState, Plan, PlannedTrial
from tams_app.study.planning import make_plan
from tams_app.summary.quality import SSIM_KINDS

Cell: TypeAlias = str | int | float | bool | None
Row: TypeAlias = dict[str, Cell]

PHASES = tuple(phase.value for phase in Phase)
_TRIAL_KEY = ("trial", "participant", "strategy", "network", "repetition")  # begins every row

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
_PHASE_SCORES: dict[str, str] = {
    **{kind: kind for kind in SSIM_KINDS},
    "damaged_fraction": "damaged_fraction",
    "undamaged_received_ssim": "undamaged_received_ssim",
    "packets_per_frame_count": "packets_per_frame",
}
_PHASE = _PHASE_SCORES | {f"{kind}_count": f"n.{kind}" for kind in SSIM_KINDS}

TRIALS_TABLE = "trials"
PHASES_TABLE = "phases"
_NEEDED_OF_TRIALS = (*_TRIAL_KEY, "practice", "seed", "completed", "success", "censored_time_s")


@dataclass(frozen=True, slots=True)
class StudyData:
    """A plan, its configuration, and its tables.

    `trials`: one row per finished trial that counts, `practice` those that do not; `phases`: one
    row per trial and phase. The first also have columns that follow from the phases:
    all_views_ssim, packets_per_frame, undamaged_ssim and summed_ssim (received, over phases with
    undamaged frames), lost_ssim (their difference), primary_view_share and success_share.
    """

    plan: Plan
    config: Config
    trials: pd.DataFrame
    practice: pd.DataFrame
    phases: pd.DataFrame
    unreadable: tuple[str, ...] = ()  # ids of trials that are done, but whose summary is gone
    folders: dict[str, Path] = field(default_factory=dict)  # by trial, empty for exported tables

    @property
    def limit_s(self) -> float:
        return self.config.trial.limit_s


def read_results(study: StudyFolder) -> StudyData:
    """Everything a report is made of; ConfigError if the folder holds no study."""
    plan, config = study.load(), study.config()
    trials: list[Row] = []
    phases: list[Row] = []
    unreadable, folders = [], {}
    for trial in sorted((one for one in plan.trials if one.is_done), key=attrgetter("id")):
        attempt = trial.last
        summary = study.summary(attempt) if attempt else None
        if attempt is None or summary is None:
            unreadable.append(trial.id)
            continue
        folders[trial.id] = study.path / attempt.folder
        trials.append(trial_row(trial, summary, study.processor(attempt), config))
        if not trial.practice:
            phases += phase_rows(trial, summary)
    tables = pd.DataFrame(trials).convert_dtypes(), pd.DataFrame(phases).convert_dtypes()
    return study_data(plan, config, *tables, tuple(unreadable), folders)


def read_tables(directory: Path, config: Config) -> StudyData:
    """A study from its exported trials.csv and phases.csv, and the configuration it was run with.

    ConfigError where they cannot be read, or are not of the plan that `config` makes.
    """
    trials, phases = (_read_csv(directory / f"{one}.csv") for one in (TRIALS_TABLE, PHASES_TABLE))
    if missing := [one for one in _NEEDED_OF_TRIALS if one not in trials.columns]:
        raise ConfigError(f"{directory}: trials.csv has no column {', '.join(missing)}")
    counts = {
        "repetitions": max(1, int(trials["repetition"].max())),
        "practice_trials": int(trials.groupby("participant")["practice"].sum().max()),
    }
    config = config.model_copy(update={"study": config.study.model_copy(update=counts)})
    plan = make_plan(config, trials["participant"].nunique())
    planned = {one.id: one for one in plan.trials}
    for key, *others in trials[["trial", "strategy", "network", "seed"]].itertuples(index=False):
        trial = planned.get(key)
        if trial is None or [trial.strategy, trial.network, trial.seed] != others:
            raise ConfigError(
                f"{directory}: trial {key} is not the one that the configuration plans: give the "
                "study's own with --config"
            )
        done = Attempt(folder=key, state=AttemptState.DONE)
        plan = plan.with_attempt(key, done)
    return study_data(plan, config, trials, phases)


def write_tables(data: StudyData, directory: Path) -> list[Path]:
    """trials.csv, trials.parquet, phases.csv, phases.parquet; LogError where they cannot be."""
    everyone = pd.concat([one for one in (data.trials, data.practice) if len(one)])
    tables = {
        TRIALS_TABLE: everyone.sort_values("trial").drop(columns=list(_DERIVED)),
        PHASES_TABLE: data.phases.drop(columns=_SHARE),
    }
    written = []
    folder = made_folder(directory)
    for name, table in tables.items():
        paths = [folder / f"{name}.csv", folder / f"{name}.parquet"]
        with new_file(paths[0]) as file:
            table.to_csv(file, index=False)
        with new_file(paths[1]) as file:
            table.to_parquet(file, index=False)
        written += paths
    return written


_SHARE = "primary_view_share"
_DERIVED = (
    "all_views_ssim",
    "packets_per_frame",
    "undamaged_ssim",
    "summed_ssim",
    "lost_ssim",
    _SHARE,
    "success_share",
)


def study_data(
    plan: Plan,
    config: Config,
    trials: pd.DataFrame,
    phases: pd.DataFrame,
    unreadable: tuple[str, ...] = (),
    folders: dict[str, Path] | None = None,
) -> StudyData:
    """The tables with all columns that a report may ask for, and those that follow from them."""
    views = config.video.views
    trials = _with_columns(trials, (*_NEEDED_OF_TRIALS, "glance_agreement_fraction"))
    relied_on = [f"relied_on_{view}_fraction" for view in views]
    needed = (*_TRIAL_KEY, "phase", "duration_s", *_PHASE_SCORES, *relied_on)
    phases = _with_columns(phases, needed)
    weights = WeightMatrix(config.policy.weights.matrix)
    phases[_SHARE] = pd.NA
    for phase in Phase:
        mine = phases["phase"] == phase.value
        column = f"relied_on_{weights.primary_view(phase)}_fraction"
        phases.loc[mine, _SHARE] = phases.loc[mine, column]
    phases[_SHARE] = phases[_SHARE].astype("Float64")

    def mean_of_phases(column: str, rows: pd.DataFrame = phases) -> pd.Series:
        means = rows.groupby("trial")[column].mean()
        return trials["trial"].map(means).astype("Float64")

    divided = phases.dropna(subset=["undamaged_received_ssim", "received_ssim"])
    undamaged = mean_of_phases("undamaged_received_ssim", divided)
    received = mean_of_phases("received_ssim", divided)
    derived = (
        trials.reindex(columns=[f"{view}_received_ssim" for view in views]).mean(axis=1),
        mean_of_phases("packets_per_frame_count"),
        undamaged,
        received,
        received - undamaged,
        mean_of_phases(_SHARE),
        trials["success"].astype("Float64"),
    )
    trials = trials.assign(**dict(zip(_DERIVED, derived, strict=True)))
    practice = trials["practice"].astype(bool)
    return StudyData(
        plan, config, trials[~practice], trials[practice], phases, unreadable, folders or {}
    )


def _with_columns(table: pd.DataFrame, columns: tuple[str, ...]) -> pd.DataFrame:
    """A copy that has all of these, empty where it had not."""
    missing = [one for one in columns if one not in table.columns]
    empty = {one: pd.array([pd.NA] * len(table), dtype="Float64") for one in missing}
    return table.assign(**empty)


def _read_csv(path: Path) -> pd.DataFrame:
    try:
        return pd.read_csv(path).convert_dtypes()
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except ValueError as error:  # pandas' parser errors, and text that is not UTF-8
        raise ConfigError(f"{path}: is no table: {error}") from error


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
    return {"trial": trial.id, **{name: getattr(trial, name) for name in _TRIAL_KEY[1:]}}


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
