"""The results of a study as two tables: read from its folder, or from exported tables."""

from __future__ import annotations

from dataclasses import dataclass, field
from operator import attrgetter
from pathlib import Path

import pandas as pd

from tams_app.config import Config
from tams_app.errors import ConfigError
from tams_app.outputs import made_folder, new_file
from tams_app.policy.weights import WeightMatrix
from tams_app.records import Phase
from tams_app.study.folder import StudyFolder
from tams_app.study.plan import Attempt, AttemptState, Plan
from tams_app.study.planning import make_plan
from tams_app.study.tables import PHASE_SCORES, TRIAL_KEY, Row, phase_rows, trial_row

TRIALS_TABLE = "trials"
PHASES_TABLE = "phases"
_NEEDED_OF_TRIALS = (*TRIAL_KEY, "practice", "seed", "completed", "success", "censored_time_s")


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
    needed = (*TRIAL_KEY, "phase", "duration_s", *PHASE_SCORES, *relied_on)
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
