"""The simulated trials of a study."""

from __future__ import annotations

import gc
import time
from dataclasses import dataclass
from pathlib import Path

import cv2

from tams_app.config import Config
from tams_app.session.virtual.trial import run_virtual_trial
from tams_app.study.runner import TrialSpec


@dataclass(frozen=True, slots=True)
class SimulatedTrialRunner:
    """Runs a study's trials in virtual time; a `TrialRunner` for `study run --sim`.

    One process per trial, one core per process. The logs are kept without the bitstream.
    """

    config: Config  # the study's

    def run(self, spec: TrialSpec, folder: Path) -> None:
        cv2.setNumThreads(1)
        recording = self.config.recording.model_copy(update={"bitstream": False})
        config = spec.configure(self.config).model_copy(update={"recording": recording})
        gc.freeze()  # what was imported lives as long as the process
        run_virtual_trial(config, spec.participant_seed, folder, time.time_ns())
