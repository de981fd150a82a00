"""`run` and `report` as a person meets them: a live line, windows, and a table at the end."""

from __future__ import annotations

import json
import os
import signal
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from types import FrameType
from typing import Any

from rich.console import Console

from tams_app.clock import MonotonicClock
from tams_app.config import Config
from tams_app.console.status import StatusLine
from tams_app.console.table import summary_tables
from tams_app.console.terminal import Key, TerminalKeys
from tams_app.console.windows import ViewWindow
from tams_app.errors import LogError, TamsError
from tams_app.recording import SessionLog, read_log
from tams_app.session.build import check_names
from tams_app.session.folder import create_session_folder
from tams_app.session.recorders import LOG_NAME
from tams_app.session.session import Session
from tams_app.study.figures import save_bitrates
from tams_app.summary import summarise
from tams_app.worker import Worker

POLL_S = 0.05
SUMMARY_NAME = "summary.json"
FIGURE_NAME = "bitrates.png"


def run_session(config: Config, arm_at_once: bool, dry_run: bool = False) -> int:
    """Run one session to its end; the exit code. Everything it leaves is in its own folder."""
    console = Console()
    check_names(config)
    folder = create_session_folder(config)
    session = Session(config, MonotonicClock(), folder, arm_at_once, dry_run)
    with _signals(session):
        session.start()
        try:
            _watch(session, console)
        finally:
            session.close()
    try:
        report_session(folder, console)
    except TamsError:
        if not session.failure:  # else that is what matters, and the reason for this
            raise
    if session.failure:
        raise TamsError(f"{session.failure} (the log is in {folder})")
    return 0


def report_session(folder: Path, console: Console | None = None) -> None:
    """Compute summary.json and bitrates.png from the log in `folder` and show the summary.

    `folder` may name the log itself. LogError if there is no log, or none of ours.
    """
    folder = _session_folder(folder)
    log = read_log(folder / LOG_NAME)
    summary: dict[str, Any] = summarise(log)
    text = json.dumps(summary, indent=2) + "\n"
    try:
        (folder / SUMMARY_NAME).write_text(text, encoding="utf-8")
        save_bitrates(log, folder / FIGURE_NAME)
    except OSError as error:
        raise LogError(f"{folder}: the summary cannot be written: {error.strerror}") from error
    console = console or Console()
    console.print(summary_tables(summary))
    if gap := _gap(log):
        console.print(gap, style="bold", highlight=False, soft_wrap=True)
    console.print(f"[bold]{folder}[/]", highlight=False)


def _session_folder(given: Path) -> Path:
    if os.path.isfile(given):
        if given.name != LOG_NAME:
            raise LogError(f"{given}: is not a session: give the folder that holds {LOG_NAME}")
        return given.parent
    if not os.path.isdir(given):
        raise LogError(f"{given}: there is no such folder: give a session folder")
    if not os.path.isfile(given / LOG_NAME):
        raise LogError(f"{given}: holds no {LOG_NAME}: give a session folder")
    return given


def _gap(log: SessionLog) -> str:
    """What the log lacks, in one sentence; empty if it is whole."""
    if log.damaged:
        return "The log is damaged: part of the session is missing from these figures."
    if log.truncated:
        return (
            "The log ends early (the session was killed, the disk was full, or the file was cut): "
            "these figures cover only what was written before."
        )
    return ""


def _watch(session: Session, console: Console) -> None:
    """Show the session until it ends; from the main thread."""
    with ExitStack() as stack:
        windows = _open_windows(session, stack)
        _read_keys(session, stack)
        line = stack.enter_context(StatusLine(console))
        stack.callback(session.stop_arm)  # however this ends, the arm comes first
        while not session.ended.wait(POLL_S if not windows else 1 / session.config.video.fps):
            session.poll()
            for window in windows:
                _refresh(session, window)
            for note in session.board.take_notes():
                line.say(note)
            line.update(session.snapshot())
        for note in session.board.take_notes():
            line.say(note)


def _open_windows(session: Session, stack: ExitStack) -> list[ViewWindow]:
    """A window per view where there is a display and nobody said --headless."""
    if session.config.headless or not _has_display():
        return []
    windows = []
    for view in session.config.video.views:
        window = ViewWindow(view, session.config.video)
        stack.callback(window.close)
        window.open()
        windows.append(window)
    return windows


def _refresh(session: Session, window: ViewWindow) -> None:
    shown = session.shown(window.view)
    if shown is not None:
        window.show(shown)
    if failure := window.poll():
        session.end(failure)


def _has_display() -> bool:
    if os.name != "posix":
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def _read_keys(session: Session, stack: ExitStack) -> None:
    actions: dict[Key, Callable[[], None]] = {
        Key.CONFIRM: session.signals.confirm,
        Key.EMERGENCY_STOP: session.signals.estop,
        Key.QUIT: lambda: session.end("ended by the operator"),
    }
    keys = TerminalKeys()
    stack.callback(keys.close)
    worker = Worker(
        "keys", keys.body(lambda key: actions[key]()), lambda _, error: session.fail(str(error))
    )
    stack.callback(worker.stop)
    worker.start()


@contextmanager
def _signals(session: Session) -> Iterator[None]:
    """Ctrl-C, SIGTERM and a closed terminal end the session in order, SIGUSR1 stops the arm."""

    def handle(number: int, _frame: FrameType | None) -> None:
        if number == signal.SIGUSR1:
            session.signals.estop()
        else:
            session.request_end(f"ended by {signal.Signals(number).name}")

    handlers = dict.fromkeys((signal.SIGINT, signal.SIGTERM, signal.SIGHUP, signal.SIGUSR1), handle)
    before = {number: signal.signal(number, handler) for number, handler in handlers.items()}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
