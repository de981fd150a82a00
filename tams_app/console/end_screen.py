"""The window after a session: what came of it, and whether to start it again."""

from __future__ import annotations

import shlex
import sys
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from tams_app.config import Config
from tams_app.console.report import PAGE_NAME
from tams_app.console.summary_tables import stop_texts, task_verdict
from tams_app.faces.commands import Command
from tams_app.faces.messages import Ended
from tams_app.faces.registry import SessionDisplay
from tams_app.faces.terminal.keys import TerminalKeys
from tams_app.printing import Console

_UNATTENDED_S = 60.0  # no person need be there where the operator is simulated
_POLL_S = 0.1


def ask_at_end(
    faces: Sequence[SessionDisplay],
    console: Console,
    config: Config,
    failure: str,
    summary: Mapping[str, Any] | None,
    folder: Path,
    signals: Sequence[str],
    may_repeat: bool,
) -> bool:
    """Show the end until it is answered, in the window or on the terminal; whether to go on anew.

    Without a face that shows it, at once: no. `failure`: of the session, "" if none. `summary`:
    None, where it has failed so that there is none. `signals`: those that have come, any of which
    ends it. `may_repeat`: whether it can be started anew from here, unless it has failed.
    """
    screens = [face for face in faces if face.is_there]
    if not screens:
        return False
    may_repeat = may_repeat and not failure
    end = end_of(summary, folder, failure, may_repeat, sys.argv)
    for screen in screens:
        screen.show_end(end)
    console.print(f"{end.key} (also here)")
    limit_s = _UNATTENDED_S if config.operator_is_simulated else None
    answer = _answer(screens, signals, limit_s)
    return may_repeat and answer is Command.CONFIRM


def end_of(
    summary: Mapping[str, Any] | None,
    folder: Path,
    failure: str,
    may_repeat: bool,
    arguments: Sequence[str],
) -> Ended:
    """The end of a session in words. `arguments`: the command that started it."""
    lines = [f"It failed: {failure}"] if failure else []
    headline = "The session has failed" if failure else "The session is over"
    if summary is not None:
        verdict = task_verdict(summary)
        headline = headline if failure else verdict[:1].upper() + verdict[1:]
        reason = summary["outcome"]["reason"] or "reason unknown"
        is_timed = summary["outcome"].get("completion_time_s") is not None
        when = "" if is_timed else f" after {summary['duration_s']:.1f} s"
        lines.append(f"Ended{when}: {reason}")
        lines += _stop_lines(summary)
        lines.append(f"Report: {folder / PAGE_NAME}")
    else:
        lines.append(f"Log: {folder}")
    if may_repeat:
        return Ended(headline, tuple(lines), "Enter: start again · Q: close")
    command = shlex.join([Path(arguments[0]).name, *arguments[1:]])
    return Ended(headline, (*lines, f"To start again: {command}"), "Q: close")


def _stop_lines(summary: Mapping[str, Any]) -> list[str]:
    if "seen" in summary:
        return ["Stops: the log of the robot's side has them."]
    stops = stop_texts(summary["arm"]["stops"])
    return [f"Stop at {when}: {why}" for when, why in stops] or ["The arm has not been stopped."]


def _answer(
    screens: Sequence[SessionDisplay], signals: Sequence[str], limit_s: float | None
) -> Command | None:
    """The first answer; None where there is none, for a signal, the time, or lack of a window."""
    end_s = None if limit_s is None else time.monotonic() + limit_s
    keys = TerminalKeys()
    keys.open()
    try:
        while not signals and all(screen.is_there for screen in screens):
            if end_s is not None and time.monotonic() >= end_s:
                return None
            answers = [screen.answer for screen in screens]
            if keys.active:
                answers += keys.read(_POLL_S)
            else:
                time.sleep(_POLL_S)
            for answer in answers:
                if answer in (Command.CONFIRM, Command.QUIT, Command.CLOSE):
                    return answer
    finally:
        keys.close()
    return None
