"""`run_tams.py` with trials that are played: for tests that start it as a process of its own."""

from __future__ import annotations

import runpy
import signal
import sys
from pathlib import Path
from types import ModuleType
from typing import Any

from tams_app.config import Config
from tams_app.errors import TamsError
from tams_app.study.plan import PlannedTrial
from tams_app.study.runner import TrialRunner, mark_ended
from tams_app.study.trial_process import Job
from tests.study.synthetic_study import PlantedRunner

RUNNING = "running"
RUN_TAMS = Path(__file__).parents[2] / "run_tams.py"


class StuckRunner:
    """Plays trials; some of them go on for ever."""

    def __init__(self, *stuck: str) -> None:
        self._stuck = stuck

    def run(self, trial: PlannedTrial, folder: Path) -> None:
        if trial.id in self._stuck:
            (folder / RUNNING).touch()
            while True:
                signal.pause()
        PlantedRunner().run(trial, folder)


class PlayedPool:
    """Trials one after the other in this process: what runs them apart is tested elsewhere."""

    slots = 1

    def __init__(self, runner: TrialRunner, workers: int | None = None) -> None:
        self._runner = runner
        self._ended: list[tuple[Job, str]] = []

    def start(self, job: Job) -> None:
        try:
            self._runner.run(job.trial, job.folder)
        except TamsError as error:
            self._ended.append((job, str(error)))
        else:
            mark_ended(job.folder)
            self._ended.append((job, ""))

    def wait(self) -> list[tuple[Job, str]]:
        ended, self._ended = self._ended, []
        return ended

    def close(self) -> None:
        """Nothing still runs."""


def played_virtual(runner: TrialRunner) -> ModuleType:
    """What stands in the place of `tams_app.session.virtual`: trials by `runner`."""

    def simulated_trial_runner(config: Config) -> TrialRunner:
        return runner

    module: Any = ModuleType("tams_app.session.virtual")
    module.SimulatedTrialRunner = simulated_trial_runner
    return module  # type: ignore[no-any-return]


def main(stuck: str) -> None:
    """The command line, of which trial `stuck` never ends."""
    sys.modules["tams_app.session.virtual"] = played_virtual(StuckRunner(stuck))
    sys.argv[0] = "run_tams.py"
    runpy.run_path(str(RUN_TAMS), run_name="__main__")
