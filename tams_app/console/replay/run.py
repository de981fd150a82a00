"""`replay`: from a session's folder to the console."""

from __future__ import annotations

import tempfile
from collections.abc import Callable
from pathlib import Path

from tams_app.config import Config
from tams_app.console.app import show_session
from tams_app.console.replay.logged_config import logged_config
from tams_app.console.replay.marks import Marking
from tams_app.console.replay.session import ReplaySession
from tams_app.console.report import session_log
from tams_app.errors import ConfigError, SignalledError, TamsError
from tams_app.faces.display import has_display
from tams_app.faces.terminal.keys import TerminalKeys
from tams_app.printing import Console
from tams_app.progress import waiting
from tams_app.recording import SessionLog, read_log
from tams_app.recording.pictures import PictureFinder
from tams_app.runtime.clock import MonotonicClock

FASTEST = 100.0


def run_replay(
    given: Path,
    speed: float = 1.0,
    headless: bool = False,
    marking_of: Callable[[SessionLog], Marking] | None = None,
) -> int:
    """Show the log of a session, or of the folder that has it, until it is ended; the exit code.

    `marking_of`: where its phases are marked by keys, the marks so far.
    """
    if not 0.01 <= speed <= FASTEST:
        raise ConfigError(f"--speed: {speed:g} is not between 0.01 and {FASTEST:g}")
    path = session_log(given)
    headless = headless or not has_display()
    console, signals = Console(), list[str]()
    with tempfile.TemporaryDirectory(prefix="tams-replay-") as folder:
        with waiting("reading the log", console):
            log = read_log(path)
            marking = None if marking_of is None else marking_of(log)
            session = ReplaySession(
                log,
                PictureFinder(path),
                _shown_config(logged_config(log, path), headless),
                Path(folder),
                speed,
                MonotonicClock().now_ns,
                _key_help(headless),
                marking,
            )
        if log.damage:
            console.print(log.damage, style="bold", highlight=False, soft_wrap=True)
        show_session(session, console, interrupted=signals.append, replay=session)
    if session.failure:
        raise TamsError(session.failure)
    if signals:
        raise SignalledError(signals[0])
    return 0


def _key_help(headless: bool) -> str:
    """The keys that work, in brackets."""
    if not headless:
        return " (Enter: pause, go on; q: end; in the window also arrows and mouse, F1 lists all)"
    return " (Enter: pause, go on; q: end)" if TerminalKeys().readable else ""


def _shown_config(config: Config, headless: bool) -> Config:
    controller = config.controller.model_copy(update={"device": "auto"})
    rig = config.rig.model_copy(update={"enabled": True})  # so that nothing is shown of an arm
    shown = {"controller": controller, "rig": rig, "headless": headless, "faces": ("window",)}
    return config.model_copy(update=shown)
