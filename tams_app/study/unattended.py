"""Runs what is left of a simulated study, many trials at a time; resumes where it was stopped."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import timedelta
from types import TracebackType
from typing import Protocol, Self

from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from tams_app.study.folder import StudyFolder
from tams_app.study.plan import Attempt, AttemptState, Plan, PlannedTrial
from tams_app.study.trial_process import Job, TrialPool

_SPEED_OVER_S = 3600.0  # the time left is judged by the trials of the last hour


@dataclass(frozen=True, slots=True)
class Tally:
    """What one call has run: trials done now, and why others failed, by trial id."""

    done: int
    failures: dict[str, str]


class ProgressDisplay(Protocol):
    """What a person sees meanwhile."""

    def say(self, text: str) -> None:
        """A sentence that stays."""

    def advance(self) -> None:
        """One more trial has ended."""


def run_unattended(study: StudyFolder, pool: TrialPool, display: ProgressDisplay) -> Tally:
    """Run every trial that has no result yet; the caller holds the study's lock.

    A trial that fails is reported and tried again by the next call, under a new name. However this
    ends, `pool` is closed and the plan tells what was cut short.
    """
    plan = study.recover(study.load())
    todo = list(plan.left)
    run = _Run(study, plan, pool, display)
    try:
        while todo or run.attempts:
            while todo and len(run.attempts) < pool.slots:
                run.start(todo.pop(0))
            run.settle(pool.wait())
    finally:
        pool.close()
        study.recover(study.load())
    return Tally(run.done, run.failures)


class _Run:
    def __init__(
        self, study: StudyFolder, plan: Plan, pool: TrialPool, display: ProgressDisplay
    ) -> None:
        self.plan = plan
        self.done = 0
        self.failures: dict[str, str] = {}
        self.attempts: dict[str, Attempt] = {}  # that run now, by trial id
        self._study = study
        self._pool = pool
        self._display = display

    def start(self, trial: PlannedTrial) -> None:
        self.plan, attempt = self._study.new_attempt(self.plan, trial.id)
        self.attempts[trial.id] = attempt
        self._pool.start(Job(trial, self._study.path / attempt.folder))

    def settle(self, ended: Sequence[tuple[Job, str]]) -> None:
        for job, failure in ended:
            trial_id = job.trial.id
            attempt = self.attempts.pop(trial_id)
            if not failure and not self._study.has_ended(attempt):
                failure = "its summary is not whole"
            state = AttemptState.FAILED if failure else AttemptState.DONE
            changed = attempt.model_copy(update={"state": state, "reason": failure})
            self.plan = self.plan.with_attempt(trial_id, changed)
            self._study.save(self.plan)
            self._count(trial_id, attempt, failure)

    def _count(self, trial_id: str, attempt: Attempt, failure: str) -> None:
        self._display.advance()
        if failure:
            self.failures[trial_id] = failure
            self._display.say(f"{trial_id} failed: {failure} (see {attempt.folder})")
        else:
            self.done += 1


class RichProgress:
    """A bar with trials done, time taken and time left."""

    def __init__(self, console: Console, total: int) -> None:
        self._progress = Progress(
            TextColumn("trials"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("left"),
            TimeRemainingColumn(),
            console=console,
            speed_estimate_period=_SPEED_OVER_S,
        )
        self._task = self._progress.add_task("trials", total=total)

    def __enter__(self) -> Self:
        self._progress.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._progress.stop()

    def say(self, text: str) -> None:
        self._progress.console.print(text, highlight=False, markup=False, soft_wrap=True)

    def advance(self) -> None:
        self._progress.advance(self._task)
        if not self._progress.console.is_terminal:  # a log file: no bar, a line each
            task = self._progress.tasks[self._task]
            line = f"{task.completed:.0f} of {task.total:.0f} trials"
            if task.time_remaining is not None:  # one trial alone tells no speed
                line += f", {timedelta(seconds=round(task.time_remaining))} left"
            self.say(line)
