"""Runs what is left of a simulated study, many trials at a time; resumes where it was stopped."""

from __future__ import annotations

from collections import deque
from datetime import timedelta

from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
)

from tams_app.printing import Console
from tams_app.study.folder import StudyFolder
from tams_app.study.plan import Attempt, AttemptState
from tams_app.study.trial_process import DaskPool, Job, LocalPool


def run_unattended(
    study: StudyFolder, pool: LocalPool | DaskPool, display: TrialsProgress
) -> dict[str, str]:
    """Run every trial that has no result yet; why some failed, by trial id.

    The caller holds the study's lock. A trial that fails is reported and tried again by the next
    call, under a new name. However this ends, `pool` is closed and the plan shows what was cut
    short.
    """
    plan = study.recover()
    failures: dict[str, str] = {}
    todo = list(plan.left)
    running: dict[str, Attempt] = {}  # by trial id
    try:
        while todo or running:
            while todo and len(running) < pool.slots:
                trial = todo.pop(0)
                plan, running[trial.id] = study.new_attempt(plan, trial.id)
                pool.start(Job(trial, study.path / running[trial.id].folder))
            for job, failure in pool.wait():
                attempt = running.pop(job.trial.id)
                if not failure and not study.has_ended(attempt):
                    failure = "its summary is not whole"
                state = AttemptState.FAILED if failure else AttemptState.DONE
                plan = study.settle(plan, job.trial.id, attempt, state=state, reason=failure)
                display.trial_ended()
                if failure:
                    failures[job.trial.id] = failure
                    display.notify(f"{job.trial.id} failed: {failure} (see {attempt.folder})")
    finally:
        pool.close()
        study.recover()
    return failures


class TrialsProgress(Progress):
    """A bar with trials done, time taken and time left."""

    def __init__(self, console: Console, total: int, slots: int = 1) -> None:
        """`slots`: how many run at a time; the time left is trials left × their mean / slots."""
        super().__init__(
            TextColumn("trials"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            TextColumn("{task.fields[left]}"),
            console=console,
        )
        self._trials = self.add_task("trials", total=total, left="")
        self._begun_s = deque([self.get_time()] * slots)
        self._took_s = 0.0  # all that have ended

    def notify(self, text: str) -> None:
        """Print a sentence that stays."""
        self.console.print(text, soft_wrap=True)

    def trial_ended(self) -> None:
        task, now_s = self.tasks[self._trials], self.get_time()
        self._took_s += now_s - self._begun_s.popleft()  # the sum is right whichever it was
        self._begun_s.append(now_s)
        self.advance(self._trials)
        left_s = self._took_s / task.completed * (task.remaining or 0) / len(self._begun_s)
        left = f"about {timedelta(seconds=round(left_s))} left"
        self.update(self._trials, left=left)
        if not self.console.is_terminal:  # a log file: no bar, a line each
            self.notify(f"{task.completed:.0f} of {task.total:.0f} trials, {left}")
