"""One trial of a study with a person at the hardware, who is not shown what is compared."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from tams_app.config import Config
from tams_app.console.app import show_session
from tams_app.console.report import write_summary
from tams_app.console.status import (
    SEPARATOR,
    Words,
    arm_line,
    arm_parts,
    fitting,
    minutes,
    reason_parts,
)
from tams_app.console.terminal import TerminalKeys
from tams_app.console.window.messages import TrialFacts
from tams_app.errors import TamsError
from tams_app.runtime.clock import MonotonicClock
from tams_app.session.build import check_names, check_ready_pose, check_views
from tams_app.session.folder import furnish_session_folder
from tams_app.session.session import Session
from tams_app.session.status import StatusSnapshot
from tams_app.study.plan import PlannedTrial

BEGINNING = (
    "The trial begins when the trigger is first pressed. End it with q: when the block is placed, "
    "or when the time is over."
)


class LiveTrialRunner:
    """Runs whole sessions for a study (its `TrialRunner`); the experimenter ends each with `q`.

    Neither live line nor window nor a table tell strategy, network, targets, weights, or what
    follows from them: rates, ages and quality.
    """

    def __init__(self, config: Config, console: Console | None = None) -> None:
        """`config`: the study's."""
        self._config = config
        self._console = console or Console()

    def run(self, trial: PlannedTrial, folder: Path) -> None:
        """Leave log, configuration, summary and frame in `folder`.

        TamsError where the session cannot be run or fails; KeyboardInterrupt where a signal ends
        it, in order.
        """
        config = trial.configure(self._config)
        check_names(config)
        check_ready_pose(config)
        check_views(config, dry_run=False)
        furnish_session_folder(config, folder)
        self._console.print(BEGINNING, highlight=False, soft_wrap=True)
        signals: list[str] = []
        session = Session(config, MonotonicClock(), folder)
        try:
            words = TrialWords(trial, config.trial.limit_s)
            show_session(session, self._console, words, signals.append, trial_of=words.facts_of)
            write_summary(folder)
        except TamsError as failure:
            if signals:
                raise KeyboardInterrupt from failure
            raise TamsError(session.failure or str(failure)) from failure
        finally:
            TerminalKeys().discard()  # the next question is not answered by keys of the trial
        if signals:
            raise KeyboardInterrupt
        if session.failure:
            raise TamsError(session.failure)


class TrialWords:
    """What is shown of a trial: the arm, the trial's time, and why the arm stopped last."""

    def __init__(self, trial: PlannedTrial, limit_s: float) -> None:
        """`limit_s`: what the trial's rules allow, from the first engagement."""
        self._trial = trial
        self._limit_s = limit_s
        self._began_s: float | None = None

    def __call__(self, snapshot: StatusSnapshot) -> Words:
        """For the terminal."""
        time = self._time(snapshot)
        full = [arm_line(snapshot), time, *reason_parts(snapshot)]
        return Words(fitting([*arm_parts(snapshot), time]), SEPARATOR.join(full))

    def facts_of(self, snapshot: StatusSnapshot) -> TrialFacts:
        """For the window."""
        kind = "practice" if self._trial.practice else "trial"
        return TrialFacts(
            self._trial.participant,
            f"{kind} {self._trial.order}",
            self._passed_s(snapshot),
            self._limit_s,
        )

    def _passed_s(self, snapshot: StatusSnapshot) -> float | None:
        if self._began_s is None and snapshot.arming.upper() == "ENGAGED":
            self._began_s = snapshot.t_s
        return None if self._began_s is None else snapshot.t_s - self._began_s

    def _time(self, snapshot: StatusSnapshot) -> str:
        limit, passed_s = minutes(self._limit_s), self._passed_s(snapshot)
        if passed_s is None:
            return f"trial: not begun, {limit} allowed"
        over = ": over, end it with q" if passed_s >= self._limit_s else ""
        return f"trial: {minutes(passed_s)} of {limit}{over}"
