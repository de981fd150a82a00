"""Studies whose truth is known: a runner that makes up results with planted effects."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tams_app.config import Config, load_config
from tams_app.errors import DeviceError
from tams_app.records import Phase
from tams_app.study.folder import StudyFolder
from tams_app.study.plan import Attempt, AttemptState, PlannedTrial
from tams_app.study.planning import make_plan
from tams_app.study.runner import mark_ended
from tams_app.summary.quality import SSIM_KINDS

if TYPE_CHECKING:
    from tams_app.study.results import StudyData

NETWORK_TIME_S = {"s1": 24.0, "s2": 32.0, "s3": 55.0}
NETWORK_SSIM = {"s1": 0.95, "s2": 0.88, "s3": 0.78}
DAMAGED = {"s1": 0.0, "s2": 0.0, "s3": 0.2}  # share of the frames


def planned_trial(trial_id: str, strategy: str, network: str) -> PlannedTrial:
    """A trial of no plan, of participant P01."""
    return PlannedTrial(
        id=trial_id,
        participant="P01",
        order=1,
        strategy=strategy,
        network=network,
        repetition=1,
        seed=5,
        participant_seed=6,
    )


@dataclass(frozen=True)
class PlantedRunner:
    """Leaves a summary.json; `time_effect_s` and `ssim_effect` are what the strategy adds."""

    time_effect_s: dict[str, float] = field(default_factory=dict)
    ssim_effect: dict[str, float] = field(default_factory=dict)
    noise_s: float = 4.0
    lapses: float = 0.04  # share of trials that are not completed
    judged: bool = True
    relied: bool = True
    lost_ssim: dict[str, float] = field(default_factory=dict)  # what loss takes on s3, by strategy
    damage_told: bool = True
    missing_phase: str | None = None
    fails: tuple[str, ...] = ()
    interrupted: tuple[str, ...] = ()  # Ctrl-C comes in these

    def run(self, trial: PlannedTrial, folder: Path) -> None:
        if trial.id in self.interrupted:
            raise KeyboardInterrupt
        if trial.id in self.fails:
            raise DeviceError(f"{trial.id}: the rig fell over")
        (folder / "summary.json").write_text(json.dumps(self.summary(trial)), encoding="utf-8")

    def summary(self, trial: PlannedTrial) -> dict[str, Any]:
        shared = np.random.default_rng([trial.seed, 1])  # what the scene does, to every strategy
        own = np.random.default_rng([trial.seed, 2, *trial.strategy.encode()])
        person = np.random.default_rng([trial.participant_seed, 3])
        time_s = max(
            6.0,
            NETWORK_TIME_S[trial.network]
            + person.normal(0, 5)
            + shared.normal(0, self.noise_s)
            + own.normal(0, self.noise_s)
            + self.time_effect_s.get(trial.strategy, 0.0),
        )
        completed = time_s <= 120 and own.random() >= self.lapses
        drops = int(own.integers(0, 3))
        outcome = {
            "completed": completed,
            "success": completed and time_s <= 90,
            "completion_time_s": round(float(time_s), 3) if completed else None,
            "drops": drops,
            "reason": "placed" if completed else "not placed in time",
        }
        if not self.judged:
            outcome = dict.fromkeys(outcome) | {"reason": ""}
        return _summary(self, trial, outcome, shared, own)


def _summary(
    runner: PlantedRunner,
    trial: PlannedTrial,
    outcome: dict[str, Any],
    shared: np.random.Generator,
    own: np.random.Generator,
) -> dict[str, Any]:
    base = NETWORK_SSIM[trial.network] + shared.normal(0, 0.01)
    base += runner.ssim_effect.get(trial.strategy, 0.0)
    by_phase = {}
    for number, phase in enumerate(Phase):
        if phase.value == runner.missing_phase:
            continue
        value = float(np.clip(base + 0.01 * np.cos(number) + own.normal(0, 0.004), 0, 1))
        by_phase[phase.value] = {
            "received_ssim": round(value, 4),
            "delivered_ssim": round(value - 0.01, 4),
            "live_ssim": round(value - 0.03, 4),
            "task_received_ssim": round(value - 0.02, 4),
            "task_delivered_ssim": round(value - 0.04, 4),
            "task_live_ssim": round(value - 0.06, 4),
            **_damage(runner, trial, value),
            "n": {"received_ssim": 100, "delivered_ssim": 104, "live_ssim": 104},
        }
    primary = {
        kind: round(float(np.mean([one[kind] for one in by_phase.values()])), 4)
        for kind in SSIM_KINDS
    }
    view = {
        "target_kbps_mean": 1800.0,
        "sent_kbps_mean": 1750.0,
        "tracking_error": 0.03 + float(own.random()) * 0.01,
        "frames_captured": 900,
        "frames_sent": 900,
        "frames_shown": 880,
        "latency_ms": {"p50": 120.0, "p95": 180.0, "p99": 210.0},
        "freezes": {"count": 1, "total_s": 0.3, "longest_s": 0.3},
        **primary,
    }
    tams = trial.strategy == "tams"
    phases = [{"t_s": 5.0 * number, "phase": one.value} for number, one in enumerate(Phase)]
    content = {
        "version": "0.0.0",
        "budget_mode": "oracle",
        "duration_s": 40.0,
        "phases": phases,
        "outcome": outcome,
        "arm": {"stops": []},
        "uplink": {"capacity_kbps": 6000.0, "loss_fraction": 0.003, "queue_ms": {"p95": 20.0}},
        "views": dict.fromkeys(("eih", "gt", "gs"), view),
        "primary_view": {
            **primary,
            "time_weighted": {"received_ssim": primary["received_ssim"] + 0.01 * tams},
            "missing_phases": [runner.missing_phase] if runner.missing_phase else [],
            "by_phase": by_phase,
        },
    }
    if runner.relied:
        share = {"eih": 0.5, "gt": 0.3, "gs": 0.2}
        relied = {"by_phase": {phase.value: share for phase in Phase}, "agreement": 0.6}
        uncertainty = {"reach": {"p50": 1.25, "p95": 2.5, "n": 40}}
        content["operator"] = {"relied_on": relied, "uncertainty_mm": uncertainty}
    return content


def _damage(runner: PlantedRunner, trial: PlannedTrial, received: float) -> dict[str, float]:
    if not runner.damage_told:
        return {}
    damaged = DAMAGED[trial.network]
    lost = runner.lost_ssim.get(trial.strategy, 0.02) if damaged else 0.0
    return {
        "damaged_fraction": damaged,
        "undamaged_received_ssim": round(received + lost, 4),
        "packets_per_frame": 4.5,
    }


def small_config(**overrides: Any) -> Config:
    """The default configuration with one repetition, for dotted keys in `overrides`."""
    dotted = {key.replace("__", "."): value for key, value in overrides.items()}
    return load_config(None, {"study.repetitions": 1, "seed": 11, **dotted})


def make_study(path: Path, participants: int = 2, **overrides: Any) -> StudyFolder:
    """A planned study in `path`."""
    config = small_config(**overrides)
    study = StudyFolder(path)
    study.create(make_plan(config, participants), config)
    return study


def fill_study(study: StudyFolder, runner: PlantedRunner, leave: tuple[str, ...] = ()) -> None:
    """Give every trial but those in `leave` a result, at once."""
    plan = study.load()
    for trial in plan.left:
        if trial.id not in leave:
            plan, attempt = study.new_attempt(plan, trial.id)
            folder = study.path / attempt.folder
            runner.run(trial, folder)
            mark_ended(folder)
            done = attempt.model_copy(update={"state": AttemptState.DONE})
            plan = plan.with_attempt(trial.id, done)
    study.save(plan)


def planted_data(
    runner: PlantedRunner,
    participants: int,
    change: dict[tuple[str, str, str], dict[str, float | None]] | None = None,
    **overrides: Any,
) -> StudyData:
    """What a report is made of, without a folder; `change`: scores by strategy, network, phase."""
    import pandas

    from tams_app.study.results import phase_rows, study_data, trial_row

    config = small_config(**overrides)
    plan = make_plan(config, participants)
    trials, phases = [], []
    for trial in plan.trials:
        summary = runner.summary(trial)
        for (*condition, phase), scores in (change or {}).items():
            if [trial.strategy, trial.network] == condition:
                summary["primary_view"]["by_phase"][phase] |= scores
        trials.append(trial_row(trial, summary, "some processor", config))
        phases += phase_rows(trial, summary)
        done = Attempt(folder=trial.id, state=AttemptState.DONE)
        plan = plan.with_attempt(trial.id, done)
    tables = (pandas.DataFrame(one).convert_dtypes() for one in (trials, phases))
    return study_data(plan, config, *tables)
