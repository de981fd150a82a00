"""The study's runner: pickled into a process, run there, and what it leaves behind."""

from __future__ import annotations

import io
import json
import time
from pathlib import Path

import pytest

from tams_app.config import load_config
from tams_app.printing import Console
from tams_app.recording import read_log, read_video
from tams_app.study.commands import run_simulated
from tams_app.study.folder import StudyFolder
from tams_app.study.planning import make_plan
from tams_app.study.runner import SimulatedTrialRunner
from tams_app.study.trial_process import Job, TrialProcess
from tests.session.virtual.runs import short
from tests.study.synthetic_study import planned_trial

pytestmark = [pytest.mark.untimed, pytest.mark.timeout(600)]
TRIAL = planned_trial("P01-04", "static", "s3")


@pytest.fixture(scope="module")
def folder(tmp_path_factory) -> Path:
    """What one trial of half a second left, in a process of its own."""
    folder = tmp_path_factory.mktemp("trial")
    runner = SimulatedTrialRunner(short(seconds=0.5))
    before_ns = time.time_ns()
    process = TrialProcess(runner, Job(TRIAL, folder))
    assert process.wait() == ""
    header = read_log(folder / "session.mcap").header
    assert before_ns < header.started_ns + header.wall_offset_ns < time.time_ns()
    return folder


def test_a_pickled_runner_leaves_summary_log_and_configuration(folder):
    names = {path.name for path in folder.iterdir()}
    assert names == {"summary.json", "session.mcap", "config.yaml", "machine.json", "trial.log"}
    assert (folder / "trial.log").read_text() == ""


def test_the_trial_is_the_one_that_was_asked_for(folder):
    summary = json.loads((folder / "summary.json").read_text())
    assert (summary["seed"], summary["strategy"], summary["network"]) == (5, "static", "s3")
    config = load_config(folder / "config.yaml")
    assert (config.name, config.seconds, config.network) == ("P01-04", 0.5, "s3")
    assert summary["outcome"]["reason"] == "ended after 0.5 s"


def test_its_log_is_kept_without_the_bitstream(folder):
    assert read_log(folder / "session.mcap").sent != []
    assert list(read_video(folder / "session.mcap", "gt")) == []


@pytest.mark.verify
def test_a_study_runs_on_it_and_goes_on_where_it_was_stopped(tmp_path):
    config = short(
        seconds=0.3,
        **{"study.strategies": ["equal", "tams"], "study.networks": ["s1"], "study.repetitions": 1},
    )
    study = StudyFolder(tmp_path / "study")
    study.create(make_plan(config, 1), config)
    first, *_ = study.load().left
    plan, _ = study.new_attempt(study.load(), first.id)  # as a crash leaves it
    study.save(plan)
    said = Console(file=io.StringIO(), width=200)
    assert run_simulated(study, SimulatedTrialRunner(config), said, workers=1) == 0
    trials = study.load().trials
    assert all(trial.is_done for trial in trials)
    assert [len(trial.attempts) for trial in trials] == [2, 1]
    seeds = {study.summary(trial.last)["seed"] for trial in trials}
    assert len(seeds) == 1  # the strategies of one participant are paired
