"""The tidy tables."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from tams_app.study.plan import Attempt, AttemptState
from tams_app.study.planning import make_plan
from tams_app.study.results import (
    PHASES,
    Row,
    phase_rows,
    read_results,
    trial_row,
    write_tables,
)
from tests.study.synthetic_study import PlantedRunner, fill_study, make_study, small_config

pytestmark = pytest.mark.untimed

pandas = pytest.importorskip("pandas")
pytest.importorskip("pyarrow")


def planted_rows(runner: PlantedRunner, **overrides: Any) -> tuple[list[Row], list[Row]]:
    """The rows of one participant's trials, and of their phases."""
    config = small_config(**overrides)
    trials, phases = [], []
    for trial in make_plan(config, 1).trials:
        summary = runner.summary(trial)
        trials.append(trial_row(trial, summary, "some processor", config))
        phases += phase_rows(trial, summary)
    return trials, phases


def test_one_row_per_trial_and_one_per_trial_and_phase(tmp_path: Path) -> None:
    study = make_study(tmp_path, 2, study__practice_trials=1)
    fill_study(study, PlantedRunner(missing_phase="ALIGN"), leave=("P02-05",))
    paths = write_tables(read_results(study), tmp_path / "tables")
    names = ["trials.csv", "trials.parquet", "phases.csv", "phases.parquet"]
    assert [path.name for path in paths] == names
    trials, phases = pandas.read_csv(paths[0]), pandas.read_csv(paths[2])
    assert len(trials) == 19
    assert trials["practice"].sum() == 2
    assert len(phases) == 17 * 6
    assert phases["received_ssim"].notna().sum() == 17 * 5
    assert {*trials["missing_phases"]} == {"ALIGN"}
    assert trials["trial"].is_monotonic_increasing
    for csv, parquet in ((paths[0], paths[1]), (paths[2], paths[3])):
        assert pandas.read_parquet(parquet).to_csv(index=False) == csv.read_text()


def test_values_are_those_of_the_summary() -> None:
    trials, phases = planted_rows(PlantedRunner())
    row = trials[0]
    assert row["eih_sent_kbps"] == 1750.0
    assert row["gt_freezes_total_s"] == 0.3
    assert row["uplink_queue_p95_ms"] == 20.0
    assert row["uplink_queue_p50_ms"] is None  # not measured
    assert row["glance_agreement_fraction"] == 0.6
    assert row["uncertainty_reach_mm"] == 1.25
    assert row["processor"] == "some processor"
    first = [one for one in phases if one["trial"] == row["trial"]]
    mean = sum(float(one["received_ssim"] or 0) for one in first) / len(first)
    assert row["primary_received_ssim"] == pytest.approx(mean, abs=1e-4)
    assert phases[0]["received_ssim_count"] == 100
    assert [one["duration_s"] for one in first] == [5.0] * 5 + [15.0]
    assert [one["phase"] for one in first] == list(PHASES)
    assert phases[0]["relied_on_eih_fraction"] == 0.5


def test_an_uncompleted_trial_has_the_limit_as_censored_time_and_no_completion_time() -> None:
    trials, _ = planted_rows(PlantedRunner({"tams": 500.0}))
    rows = {(row["strategy"], row["network"]): row for row in trials}
    slow = rows["tams", "s1"]
    assert (slow["completed"], slow["completion_time_s"]) == (False, None)
    assert slow["censored_time_s"] == 120.0


def test_the_experimenter_s_verdict_stands_before_the_simulator_s() -> None:
    config = small_config()
    trial = make_plan(config, 1).trials[0]
    summary = PlantedRunner().summary(trial)
    verdict = {"completed": True, "success": False, "drops": 3, "completion_time_s": 44.0}
    attempt = Attempt.model_validate(
        {"folder": "a", "state": AttemptState.DONE, "verdict": verdict}
    )
    judged = trial.model_copy(update={"attempts": (attempt,)})
    row = trial_row(judged, summary, None, config)
    told = [row[key] for key in ("completed", "success", "drops_count", "completion_time_s")]
    assert told == [True, False, 3, 44.0]


def test_every_measured_column_names_its_unit() -> None:
    units = ("_s", "_ms", "_mm", "_kbps", "_fraction", "_ssim", "_count", "_percent", "_mb")
    plain = {"repetition", "order", "seed", "participant_seed"}
    for rows in planted_rows(PlantedRunner()):
        for row in rows:
            for column, value in row.items():
                if isinstance(value, float) or (
                    isinstance(value, int) and not isinstance(value, bool) and column not in plain
                ):
                    assert column.endswith(units), column
