"""One trial of a study with a person at the hardware, who is not shown what is compared."""

from __future__ import annotations

from pathlib import Path

from rich.console import Console

from tams_app.config import Config
from tams_app.console.app import show_session
from tams_app.console.report import write_summary
from tams_app.console.status import arm_line, minutes, reason_lines
from tams_app.console.terminal import TerminalKeys
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

    Neither live line nor windows nor a table tell strategy, network, targets, weights, or what
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
            show_session(session, self._console, TrialLines(config.trial.limit_s), signals.append)
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


class TrialLines:
    """The live line of a trial: the arm, the trial's time, and why the arm stopped last."""

    def __init__(self, limit_s: float) -> None:
        """`limit_s`: what the trial's rules allow, from the first engagement."""
        self._limit_s = limit_s
        self._began_s: float | None = None

    def __call__(self, snapshot: StatusSnapshot) -> list[str]:
        if self._began_s is None and snapshot.arming.upper() == "ENGAGED":
            self._began_s = snapshot.t_s
        return [arm_line(snapshot), self._time(snapshot.t_s), *reason_lines(snapshot)]

    def _time(self, t_s: float) -> str:
        limit = minutes(self._limit_s)
        if self._began_s is None:
            return f"trial: not begun, {limit} allowed"
        passed_s = t_s - self._began_s
        over = ": the time is over, end it with q" if passed_s >= self._limit_s else ""
        return f"trial: {minutes(passed_s)} of {limit}{over}"
