"""Trials side by side on this machine, each pinned to a core of its own."""

from __future__ import annotations

import os
import time
from typing import Protocol

from tams_app.study.runner import TrialRunner
from tams_app.study.trial_process import Job, TrialProcess

_POLL_S = 0.05


class TrialPool(Protocol):
    """Somewhere that trials run side by side."""

    @property
    def slots(self) -> int:
        """How many at a time, at least 1."""

    def start(self, job: Job) -> None:
        """Begin a trial; at most `slots` run at a time."""

    def wait(self) -> list[tuple[Job, str]]:
        """Wait for at least one to end: what ended, and why it failed ("" if it did not)."""

    def close(self) -> None:
        """End those that still run; may be called twice."""


class LocalPool:
    """Processes on this machine; `workers` None: one for each core that we may use."""

    def __init__(self, runner: TrialRunner, workers: int | None = None) -> None:
        cores = _usable_cores()
        self._slots = workers or len(cores)
        self._runner = runner
        pinned = self._slots <= len(cores)  # more than cores: the system shares them out
        self._free: list[int | None] = list(cores) if pinned else [None] * self._slots
        self._running: dict[TrialProcess, int | None] = {}

    @property
    def slots(self) -> int:
        return self._slots

    def start(self, job: Job) -> None:
        core = self._free.pop(0)
        self._running[TrialProcess(self._runner, job, core)] = core

    def wait(self) -> list[tuple[Job, str]]:
        while self._running:
            ended = [(one, failure) for one in self._running if (failure := one.poll()) is not None]
            if ended:
                for process, _ in ended:
                    self._free.append(self._running.pop(process))
                return [(process.job, failure) for process, failure in ended]
            time.sleep(_POLL_S)
        return []

    def close(self) -> None:
        for process in self._running:
            process.stop()
        self._running.clear()


def _usable_cores() -> list[int]:
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))
