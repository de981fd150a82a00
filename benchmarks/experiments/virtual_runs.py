"""Trials in virtual time for the benchmarks: one process each, and what encoding cost in it."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from contextlib import closing
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from tams_app.config import Config
from tams_app.errors import TamsError
from tams_app.records import Frame
from tams_app.session.virtual.runner import run_virtual_trial
from tams_app.study.plan import PlannedTrial
from tams_app.study.runner import SUMMARY_NAME
from tams_app.study.trial_process import Job, LocalPool
from tams_app.video.virtual.shared import VideoRecord
from tams_app.video.virtual.video import VirtualVideo

ENCODING_NAME = "encoding.json"


@dataclass(frozen=True, slots=True)
class VirtualRuns:
    """Runs the configuration that belongs to a trial's id; a `TrialRunner`."""

    configs: Mapping[str, Config]

    def run(self, trial: PlannedTrial, folder: Path) -> None:
        cv2.setNumThreads(1)
        costs = _time_encoding()
        run_virtual_trial(self.configs[trial.id], trial.seed, folder, time.time_ns())
        text = json.dumps({"frames": len(costs), "cpu_ms_per_frame": float(np.median(costs))})
        (folder / ENCODING_NAME).write_text(text + "\n", encoding="utf-8")

    def job(self, trial_id: str, out: Path) -> Job:
        """The trial `trial_id` with a new folder of its name in `out`."""
        config, folder = self.configs[trial_id], out / trial_id
        folder.mkdir()
        trial = PlannedTrial(
            id=trial_id,
            participant="P01",
            order=1,
            strategy=config.strategy,
            network=config.network,
            repetition=1,
            seed=config.seed,
            participant_seed=config.seed,
        )
        return Job(trial, folder)


def run_side_by_side(
    configs: Mapping[str, Config],
    out: Path,
    processes: int,
    ended: Callable[[], None],
) -> None:
    """Run every trial into a folder of `out` with its id; TamsError if one fails.

    `ended` is called as each ends.
    """
    runs, waiting, running = VirtualRuns(configs), list(configs), 0
    with closing(LocalPool(runs, processes)) as pool:
        while waiting or running:
            while waiting and running < pool.slots:
                pool.start(runs.job(waiting.pop(0), out))
                running += 1
            for job, failure in pool.wait():
                running -= 1
                if failure:
                    raise TamsError(f"{job.trial.id} failed: {failure}")
                ended()


def read_summary(folder: Path) -> dict[str, Any]:
    """summary.json of a trial that ran."""
    content: dict[str, Any] = json.loads((folder / SUMMARY_NAME).read_text(encoding="utf-8"))
    return content


def read_encoding_ms(folder: Path) -> float:
    """Processor time per frame [ms], median: colour conversion, x264, packetising, one thread."""
    content = json.loads((folder / ENCODING_NAME).read_text(encoding="utf-8"))
    return float(content["cpu_ms_per_frame"])


def _time_encoding() -> list[float]:
    """Note what each push into an encoder costs from now on: it returns once it has encoded."""
    costs: list[float] = []
    push: Callable[[VirtualVideo, Frame, bool], list[VideoRecord]] = VirtualVideo.push

    def timed(video: VirtualVideo, frame: Frame, left_out: bool) -> list[VideoRecord]:
        began_s = time.process_time()
        records = push(video, frame, left_out)
        costs.append((time.process_time() - began_s) * 1e3)
        return records

    VirtualVideo.push = timed  # type: ignore[method-assign, assignment]
    return costs
