"""One trial of a study with a person at the hardware, who is not shown what is compared."""

from __future__ import annotations

import threading
from pathlib import Path

from tams_app.config import Config
from tams_app.console.app import check_session, show_session
from tams_app.console.report import write_summary
from tams_app.errors import TamsError
from tams_app.faces.commands import Command
from tams_app.faces.messages import TrialFacts
from tams_app.faces.terminal.keys import TerminalKeys
from tams_app.faces.terminal.line import (
    SEPARATOR,
    Words,
    arm_line,
    arm_parts,
    fitting,
    minutes,
    reason_parts,
)
from tams_app.printing import Console, waiting
from tams_app.records import SessionState
from tams_app.robot.control import Signals
from tams_app.runtime.clock import MonotonicClock
from tams_app.session.folder import furnish_session_folder, session_bytes
from tams_app.session.run import run
from tams_app.session.session import Outset
from tams_app.study.guided import DROPS_FACT, MAX_DROPS, PLACED_FACT
from tams_app.study.plan import PlannedTrial

BEGINNING = (
    "The trial begins when the trigger is first pressed. p ends it when the block is placed, q "
    "when the time is over; x counts a drop, Backspace takes one back."
)


class LiveTrialRunner:
    """Runs whole sessions for a study (its `TrialRunner`); the experimenter ends each by key.

    Neither live line nor window nor a table show strategy, network, targets, weights, or what
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
        check_session(config, False, session_bytes(config))
        furnish_session_folder(config, folder)
        self._console.print(BEGINNING, soft_wrap=True)
        signals: list[str] = []
        outset = Outset(config, MonotonicClock(), folder, Signals())
        try:
            shown = LiveTrial(trial, config.trial.limit_s, outset)
            show_session(outset, run(outset), self._console, shown.words, signals, trial=shown)
            outset.require_whole_log()
            with waiting("writing the summary", self._console):
                write_summary(folder)
        except TamsError as failure:
            if signals:
                raise KeyboardInterrupt from failure
            raise TamsError(outset.failure or str(failure)) from failure
        finally:
            TerminalKeys().discard()  # the next question is not answered by keys of the trial
        if signals:
            raise KeyboardInterrupt
        if outset.failure:
            raise TamsError(outset.failure)


class LiveTrial:
    """A trial as it is shown, with the experimenter's marks.

    That is the arm, the trial's time, its drops, and why the arm stopped last. Marks are facts of
    the log; the verdict is asked for when the trial has ended.
    """

    def __init__(self, trial: PlannedTrial, limit_s: float, session: Outset) -> None:
        """`limit_s`: what the trial's rules allow, from the first engagement."""
        self._trial = trial
        self._limit_s = limit_s
        self._session = session
        self._began_s: float | None = None
        self._drops = 0
        self._lock = threading.Lock()  # window and terminal have threads of their own

    def mark(self, command: Command) -> None:
        """Carry out a command that is for a trial only."""
        if command is Command.PLACED:
            self._place()
        else:
            self._count(1 if command is Command.DROP else -1)

    def words(self, state: SessionState) -> Words:
        """The trial for the terminal."""
        time = self._time(state)
        why = reason_parts(state)
        full = [arm_line(state), time, *why]
        return Words(fitting([*arm_parts(state), time]), SEPARATOR.join(full), "".join(why))

    def facts_of(self, state: SessionState) -> TrialFacts:
        """The trial for the window."""
        kind = "practice" if self._trial.practice else "trial"
        return TrialFacts(
            self._trial.participant,
            f"{kind} {self._trial.order}",
            self._passed_s(state),
            self._limit_s,
            self._drops,
        )

    def _count(self, more: int) -> None:
        with self._lock:
            drops = min(max(0, self._drops + more), MAX_DROPS)
            if drops == self._drops:
                return
            self._drops = drops
            self._session.fact(DROPS_FACT, str(drops))
        self._session.note("info", f"drops: {drops}")

    def _place(self) -> None:
        if self._began_s is None:
            self._session.note("info", "the trial has not begun, so nothing is placed; q ends it")
            return
        self._session.fact(PLACED_FACT, "yes")
        self._session.end("the block is placed, says the experimenter")

    def _passed_s(self, state: SessionState) -> float | None:
        if self._began_s is None and state.arming.upper() == "ENGAGED":
            self._began_s = state.t_s
        return None if self._began_s is None else state.t_s - self._began_s

    def _time(self, state: SessionState) -> str:
        limit, passed_s = minutes(self._limit_s), self._passed_s(state)
        if passed_s is None:
            return f"trial: not begun, {limit} allowed"
        over = ": over, end it with q" if passed_s >= self._limit_s else ""
        return f"trial: {minutes(passed_s)} of {limit}{over}"
