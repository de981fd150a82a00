"""`replay`: from a session's folder to the console."""

from __future__ import annotations

import tempfile
from pathlib import Path

from pydantic import ValidationError

from tams_app.config import Config
from tams_app.console.app import show_session
from tams_app.console.replay.marks import FILE_NAME, Marking
from tams_app.console.replay.session import ReplaySession
from tams_app.console.report import session_log
from tams_app.errors import ConfigError, SetupError, SignalledError, TamsError, UnreadableLogError
from tams_app.faces.display import has_display
from tams_app.faces.terminal.keys import TerminalKeys
from tams_app.printing import Console, waiting
from tams_app.recording import SessionLog, read_log
from tams_app.recording.reader import PictureFinder
from tams_app.runtime.clock import MonotonicClock
from tams_app.units import NS_PER_S

FASTEST = 100.0


def run_replay(given: Path, speed: float = 1.0, headless: bool = False, mark: bool = False) -> None:
    """Show the log of a session, or of the folder that has it, until it is ended.

    `mark`: its phases are marked by keys; goes on with the marks beside the log.
    """
    if not 0.01 <= speed <= FASTEST:
        raise ConfigError(f"--speed: {speed:g} is not between 0.01 and {FASTEST:g}")
    path = session_log(given)
    headless = headless or not has_display()
    if mark and headless:
        raise SetupError(
            "--mark shows the session in a window: start it where there is a display, or write "
            f"{FILE_NAME} beside the log by hand as docs/calibration/phases.md says"
        )
    console, signals = Console(), list[str]()
    with tempfile.TemporaryDirectory(prefix="tams-replay-") as folder:
        with waiting("reading the log", console):
            log = read_log(path)
            marking = _marking(path, log) if mark else None
            session = ReplaySession(
                log,
                PictureFinder(path),
                _shown_config(_logged_config(log, path), headless),
                Path(folder),
                speed,
                MonotonicClock(),
                _key_help(headless),
                marking,
            )
        if log.damage:
            console.print(log.damage, style="bold", soft_wrap=True)
        show_session(session, session, console, signals=signals, replay=session)
    if session.failure:
        raise TamsError(session.failure)
    if signals:
        raise SignalledError(signals[0])


def _marking(path: Path, log: SessionLog) -> Marking:
    if not any(tick.arm is not None for tick in log.ticks):
        raise UnreadableLogError(
            f"{path}: has no state of the arm in it: give a session in which the arm was connected"
        )
    last_s = (log.ticks[-1].started_ns - log.header.started_ns) / NS_PER_S
    return Marking(path.parent / FILE_NAME, last_s)


def _key_help(headless: bool) -> str:
    """The keys that work, in brackets."""
    if not headless:
        return " (Enter: pause, go on; q: end; in the window also arrows and mouse, F1 lists all)"
    return " (Enter: pause, go on; q: end)" if TerminalKeys().readable else ""


def _logged_config(log: SessionLog, path: Path) -> Config:
    """The configuration in `log`, read from `path`; UnreadableLogError if it has other keys."""
    try:
        return Config.model_validate(log.header.config)
    except ValidationError as error:
        raise UnreadableLogError(
            f"{path}: its configuration is of another version of TAMS; use that to replay it"
        ) from error


def _shown_config(config: Config, headless: bool) -> Config:
    controller = config.controller.model_copy(update={"device": "auto"})
    rig = config.rig.model_copy(update={"enabled": True})  # so that nothing is shown of an arm
    shown = {"controller": controller, "rig": rig, "headless": headless, "faces": ("window",)}
    return config.model_copy(update=shown)
