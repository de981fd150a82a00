"""The tidy tables."""

from __future__ import annotations

from pathlib import Path

import pytest

from tams_app.study.results import read_results
from tams_app.study.tables import phase_rows, trial_rows, write_tables
from tests.study.synthetic_study import PlantedRunner, fill_study, make_study

pytestmark = pytest.mark.untimed

pandas = pytest.importorskip("pandas")
pytest.importorskip("pyarrow")


def test_one_row_per_trial_and_one_per_trial_and_phase(tmp_path: Path) -> None:
    study = make_study(tmp_path, 2, study__practice_trials=1)
    fill_study(study, PlantedRunner(missing_phase="ALIGN"), leave=("P02-05",))
    data = read_results(study)
    rows = trial_rows(data)
    assert len(rows) == 19
    assert sum(bool(row["practice"]) for row in rows) == 2
    assert len(phase_rows(data)) == 17 * 5
    assert {row["missing_phases"] for row in rows} == {"ALIGN"}


def test_values_are_those_of_the_summary(tmp_path: Path) -> None:
    study = make_study(tmp_path, 1)
    fill_study(study, PlantedRunner())
    data = read_results(study)
    row, result = trial_rows(data)[0], data.results[0]
    assert row["eih_sent_kbps"] == 1750.0
    assert row["gt_freezes_total_s"] == 0.3
    assert row["uplink_queue_p95_ms"] == 20.0
    assert row["uplink_queue_p50_ms"] is None  # not measured
    assert row["primary_received_ssim"] == result.summary["primary_view"]["received_ssim"]
    phases = phase_rows(data)
    assert phases[0]["received_ssim_count"] == 100
    assert [row["duration_s"] for row in phases[:6]] == [5.0] * 5 + [15.0]
    assert phases[0]["relied_on_eih_fraction"] == 0.5


def test_an_uncompleted_trial_has_the_limit_as_censored_time_and_no_completion_time(
    tmp_path: Path,
) -> None:
    study = make_study(tmp_path, 1)
    fill_study(study, PlantedRunner({"tams": 500.0}))
    rows = {(row["strategy"], row["network"]): row for row in trial_rows(read_results(study))}
    slow = rows["tams", "s1"]
    assert (slow["completed"], slow["completion_time_s"]) == (False, None)
    assert slow["censored_time_s"] == 120.0


def test_parquet_and_csv_hold_the_same(tmp_path: Path) -> None:
    study = make_study(tmp_path, 1)
    fill_study(study, PlantedRunner())
    paths = write_tables(read_results(study), tmp_path / "tables")
    assert [path.name for path in paths] == [
        "trials.csv",
        "trials.parquet",
        "phases.csv",
        "phases.parquet",
    ]
    csv, parquet = pandas.read_csv(paths[0]), pandas.read_parquet(paths[1])
    assert list(csv.columns) == list(parquet.columns)
    assert csv["censored_time_s"].tolist() == parquet["censored_time_s"].tolist()
    assert parquet["trial"].tolist() == [f"P01-{n:02}" for n in range(1, 10)]


def test_every_measured_column_names_its_unit(tmp_path: Path) -> None:
    study = make_study(tmp_path, 1)
    fill_study(study, PlantedRunner())
    units = ("_s", "_ms", "_kbps", "_fraction", "_ssim", "_count", "_percent", "_mb")
    plain = {"repetition", "order", "seed", "participant_seed"}
    for row in trial_rows(read_results(study)):
        for column, value in row.items():
            if isinstance(value, float) or (
                isinstance(value, int) and not isinstance(value, bool) and column not in plain
            ):
                assert column.endswith(units), column
