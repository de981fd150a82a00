"""The run of a study's trials, live or simulated, and the files that a trial leaves."""

from __future__ import annotations

import gc
import json
import platform
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol

from tams_app.config import Config
from tams_app.outputs import write_file
from tams_app.study.plan import PlannedTrial

SUMMARY_NAME = "summary.json"
MACHINE_NAME = "machine.json"  # written last: it also marks a trial that ran to its end


class TrialRunner(Protocol):
    """Runs one trial. Pickled into a process of its own where trials run in parallel."""

    def run(self, trial: PlannedTrial, folder: Path) -> None:
        """Leave summary.json and the log in `folder`, which exists and is empty but for logs.

        Raises TamsError, a sentence, where the trial cannot be run.
        """


@dataclass(frozen=True, slots=True)
class SimulatedTrialRunner:
    """Runs a study's trials in virtual time, for `study run --sim`.

    One process per trial, one core per process. The logs are kept without bitstream and pictures.
    """

    config: Config  # the study's

    def run(self, trial: PlannedTrial, folder: Path) -> None:
        from tams_app.session.virtual.runner import run_virtual_trial  # in the trial's process only

        kept = {"bitstream": False, "pictures_per_s": 0.0}
        recording = self.config.recording.model_copy(update=kept)
        config = trial.configure(self.config).model_copy(update={"recording": recording})
        gc.freeze()  # what was imported lives as long as the process
        run_virtual_trial(config, trial.participant_seed, folder, time.time_ns())


def mark_ended(folder: Path) -> None:
    """Write machine.json into a trial's folder, after everything else."""
    text = json.dumps(machine(), indent=1) + "\n"
    write_file(folder / MACHINE_NAME, text)


def machine() -> dict[str, str]:
    """The machine that a result may depend on: processor, system, Python."""
    return {
        "processor": _processor(),
        "architecture": platform.machine(),
        "system": f"{platform.system()} {platform.release()}",
        "python": platform.python_version(),
    }


def _processor() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        return platform.processor()
    named = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return named[0] if named else platform.processor()
