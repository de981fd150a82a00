"""Trials on a Dask cluster: a real scheduler with two worker processes on this machine."""

from __future__ import annotations

import io
import tarfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from tams_app.errors import LogError, SetupError
from tams_app.study.trial_process import DaskPool, pack, run_and_pack, unpack
from tams_app.study.unattended import run_unattended
from tests.study.synthetic_study import PlantedRunner, make_study, planned_trial
from tests.study.test_unattended import SMALL

pytestmark = pytest.mark.untimed

TRIAL = planned_trial("P01-01", "tams", "s2")


@pytest.fixture
def cluster() -> Iterator[Any]:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(
        n_workers=2,
        threads_per_worker=1,
        processes=True,
        host="127.0.0.1",
        dashboard_address=None,
    ) as found:
        yield found


@pytest.mark.verify
def test_trials_come_back_from_the_cluster_and_a_failed_one_is_reported(
    cluster: Any, tmp_path: Path
) -> None:
    study = make_study(tmp_path, 1, **SMALL)
    pool = DaskPool(PlantedRunner(fails=("P01-02",)), cluster.scheduler_address)
    assert pool.slots == 2
    failures = run_unattended(study, pool, Mock())
    assert failures == {"P01-02": "P01-02: the rig fell over"}
    assert [trial.id for trial in study.load().left] == ["P01-02"]
    for trial in study.load().trials:
        folder = tmp_path / trial.attempts[0].folder
        assert (folder / "trial.log").is_file()
        assert (folder / "machine.json").is_file() == trial.is_done


def test_no_scheduler_is_one_sentence(monkeypatch: pytest.MonkeyPatch) -> None:
    pytest.importorskip("distributed")
    with pytest.raises(SetupError, match="no scheduler answers there"):
        DaskPool(PlantedRunner(), "nonsense://127.0.0.1:1")


def test_a_worker_runs_a_trial_in_a_process_of_its_own(tmp_path: Path) -> None:
    failure, archive = run_and_pack(PlantedRunner(), TRIAL)
    assert failure == ""
    with tarfile.open(fileobj=io.BytesIO(archive)) as contents:
        assert contents.getnames()[-1] == "machine.json"  # where it is, all is
    unpack(archive, tmp_path)
    assert sorted(path.name for path in tmp_path.iterdir()) == [
        "machine.json",
        "summary.json",
        "trial.log",
    ]


def test_folders_survive_packing_and_a_disk_that_refuses_is_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "from/helpers").mkdir(parents=True)
    (tmp_path / "from/helpers/rig.log").write_text("text")
    archive = pack(tmp_path / "from")
    (tmp_path / "to").mkdir()
    unpack(archive, tmp_path / "to")
    assert (tmp_path / "to/helpers/rig.log").read_text() == "text"
    (tmp_path / "file").write_text("in the way")
    with pytest.raises(LogError, match="cannot be put there"):
        unpack(archive, tmp_path / "file")
