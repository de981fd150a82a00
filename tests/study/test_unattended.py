"""Trials in processes of their own: failures are no matter of the rest, and all can be resumed."""

from __future__ import annotations

import io
import os
import re
import signal
import time
from collections import deque
from dataclasses import dataclass
from pathlib import Path
from unittest.mock import Mock

import psutil
import pytest

from tams_app.printing import Console
from tams_app.study.commands import run_simulated
from tams_app.study.plan import AttemptState, PlannedTrial
from tams_app.study.trial_process import Job, LocalPool, TrialProcess
from tams_app.study.unattended import TrialsProgress, run_unattended
from tests.study.synthetic_study import PlantedRunner, make_study, planned_trial

pytestmark = pytest.mark.untimed

SMALL = {"study__strategies": ["equal", "tams"], "study__networks": ["s1", "s2"]}


@dataclass(frozen=True)
class Misbehaving:
    """Fails in the way that its trial's order asks for."""

    def run(self, trial: PlannedTrial, folder: Path) -> None:
        match trial.id[-2:]:
            case "01":
                os.kill(os.getpid(), signal.SIGSEGV)
            case "02":
                raise RuntimeError("a bug")
            case "03":
                pass  # no summary
            case _:
                PlantedRunner().run(trial, folder)


class Endless:
    def run(self, trial: PlannedTrial, folder: Path) -> None:
        (folder / "running").touch()
        while True:
            signal.pause()


PLANNED = planned_trial("P01-04", "tams", "s2")


@pytest.mark.verify
def test_a_crashed_process_a_bug_and_a_missing_summary_are_reported_and_not_fatal(
    tmp_path: Path,
) -> None:
    study = make_study(tmp_path, 1, **SMALL)
    failures = run_unattended(study, LocalPool(Misbehaving(), workers=2), Mock())
    assert sum(trial.is_done for trial in study.load().trials) == 1
    assert failures == {
        "P01-01": "its process was ended by SIGSEGV",
        "P01-02": "RuntimeError: a bug",
        "P01-03": "it left no summary.json",
    }
    log = tmp_path / study.load().trial("P01-02").attempts[0].folder / "trial.log"
    assert "Traceback" in log.read_text()


class InterruptedPool(LocalPool):
    """Ctrl-C comes once both trials run."""

    def wait(self) -> list[tuple[Job, str]]:
        while not all((process.job.folder / "running").exists() for process in self._running):
            time.sleep(0.02)
        self.pids = [process._process.pid for process in self._running]
        raise KeyboardInterrupt


def test_an_interruption_ends_what_runs_and_the_study_goes_on_later(tmp_path: Path) -> None:
    study = make_study(tmp_path, 1, **SMALL)
    pool = InterruptedPool(Endless(), workers=2)
    with pytest.raises(KeyboardInterrupt):
        run_unattended(study, pool, Mock())
    assert not any(psutil.pid_exists(pid) for pid in pool.pids)
    started = [trial for trial in study.load().trials if trial.attempts]
    assert [trial.attempts[0].state for trial in started] == [AttemptState.INTERRUPTED] * 2
    assert len(study.load().left) == 4


def test_a_trial_keeps_to_its_core_and_says_what_machine_it_ran_on(tmp_path: Path) -> None:
    core = min(os.sched_getaffinity(0))
    process = TrialProcess(PinnedRunner(), Job(PLANNED, tmp_path), core)
    assert process.wait() == ""
    assert (tmp_path / "cores").read_text() == str([core])
    assert '"processor"' in (tmp_path / "machine.json").read_text()


@dataclass(frozen=True)
class PinnedRunner:
    def run(self, trial: PlannedTrial, folder: Path) -> None:
        (folder / "cores").write_text(str(sorted(os.sched_getaffinity(0))))
        PlantedRunner().run(trial, folder)


def test_trials_run_in_processes_and_a_failed_one_is_retried_under_a_new_name(
    tmp_path: Path,
) -> None:
    output = io.StringIO()
    console = Console(file=output, width=200)
    study = make_study(tmp_path, 1, **{**SMALL, "study__networks": ["s1"]})
    assert run_simulated(study, PlantedRunner(fails=("P01-01",)), console, workers=2) == 1
    assert "P01-01 failed: P01-01: the rig fell over" in output.getvalue()
    assert "1 trials done, 1 failed" in output.getvalue()
    before = {path: path.read_bytes() for path in tmp_path.rglob("summary.json")}
    assert run_simulated(study, PlantedRunner(), console, workers=1) == 0
    assert all(trial.is_done for trial in study.load().trials)
    failed, done = study.load().trial("P01-01").attempts
    assert (failed.state, done.state) == (AttemptState.FAILED, AttemptState.DONE)
    assert {path: path.read_bytes() for path in before} == before
    assert (tmp_path / failed.folder / "trial.log").is_file()


def test_the_bar_shows_trials_and_time_left() -> None:
    output = io.StringIO()
    console = Console(file=output, width=120, force_terminal=True)
    with TrialsProgress(console, 3) as display:
        display.trial_ended()
        display.notify("P01-01 failed: [bold]no markup[/]")
    assert "1/3" in output.getvalue()
    assert "left" in output.getvalue()
    assert "[bold]no markup[/]" in output.getvalue()


def test_in_a_log_file_each_trial_is_a_line_with_the_time_left_by_mean_and_workers() -> None:
    output, now_s = io.StringIO(), [100.0]
    display = TrialsProgress(Console(file=output, width=120), 20, slots=2)
    display.get_time = lambda: now_s[0]
    display._begun_s = deque([100.0, 100.0])
    for ended_s in (110.0, 110.1, 120.0, 120.2):  # two at a time, 10 s each
        now_s[0] = ended_s
        display.trial_ended()
    line = re.compile(r"^(\d) of 20 trials, about 0:0(\d):(\d\d) left$", re.MULTILINE)
    told = line.findall(output.getvalue())
    assert [number for number, *_ in told] == ["1", "2", "3", "4"]
    left_s = [60 * int(minutes) + int(seconds) for _, minutes, seconds in told]
    assert left_s == pytest.approx([95, 90, 85, 80], abs=2)
