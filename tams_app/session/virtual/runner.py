"""Virtual trials as a study runs them: one process for each, their logs, their summaries."""

from __future__ import annotations

import gc
import time
from dataclasses import dataclass
from pathlib import Path

import cv2

from tams_app.config import Config
from tams_app.recording import LOG_NAME, read_log
from tams_app.records import Outcome
from tams_app.runtime.kept_memory import keep_freed_memory
from tams_app.session.folder import furnish_session_folder
from tams_app.session.virtual.trial import VirtualTrial
from tams_app.study.plan import PlannedTrial
from tams_app.summary.summarise import save_summary, summarise


def run_virtual_trial(
    config: Config, participant_seed: int, folder: Path, wall_start_ns: int
) -> Outcome:
    """Run one trial to its end; session.mcap, config.yaml and summary.json are in `folder` then.

    In the main thread of a process that does nothing else (`tams_app.video.virtual`).
    `wall_start_ns`: when it began by the wall's clock, for the log's header. The same arguments
    leave the same bytes on the same machine.
    """
    keep_freed_memory()
    cv2.setNumThreads(1)
    furnish_session_folder(config, folder)
    trial = VirtualTrial(config, participant_seed, folder, wall_start_ns)
    try:
        outcome = trial.run()
    finally:
        trial.close()
    save_summary(summarise(read_log(folder / LOG_NAME)), folder)
    return outcome


@dataclass(frozen=True, slots=True)
class SimulatedTrialRunner:
    """Runs a study's trials in virtual time; a `TrialRunner` for `study run --sim`.

    One process per trial, one core per process. The logs are kept without bitstream and pictures.
    """

    config: Config  # the study's

    def run(self, trial: PlannedTrial, folder: Path) -> None:
        kept = {"bitstream": False, "pictures_per_s": 0.0}
        recording = self.config.recording.model_copy(update=kept)
        config = trial.configure(self.config).model_copy(update={"recording": recording})
        gc.freeze()  # what was imported lives as long as the process
        run_virtual_trial(config, trial.participant_seed, folder, time.time_ns())
