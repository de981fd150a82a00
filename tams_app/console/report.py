"""What a session leaves for people: summary.json, the frame of the bitrates, a table."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Any

from rich.console import Console

from tams_app.console.table import summary_tables
from tams_app.errors import LogError
from tams_app.recording import SessionLog, read_log
from tams_app.session.recorders import LOG_NAME
from tams_app.summary.file import save_summary

FIGURE_NAME = "bitrates.png"


def report_session(folder: Path, console: Console | None = None) -> None:
    """Compute summary.json and bitrates.png from the log in `folder` and show the summary.

    `folder` may name the log itself. LogError if there is no log, or none of ours.
    """
    folder = _session_folder(folder)
    log, summary = write_summary(folder)
    console = console or Console()
    console.print(summary_tables(summary))
    if gap := _gap(log):
        console.print(gap, style="bold", highlight=False, soft_wrap=True)
    console.print(f"[bold]{folder}[/]", highlight=False)


def write_summary(folder: Path) -> tuple[SessionLog, dict[str, Any]]:
    """Compute summary.json and bitrates.png from the log in `folder`, and show nothing."""
    from tams_app.study.figures import save_bitrates  # matplotlib: no session starts with it

    log = read_log(folder / LOG_NAME)
    summary = save_summary(log, folder)
    try:
        save_bitrates(log, folder / FIGURE_NAME)
    except OSError as error:
        raise LogError(f"{folder}: the frame cannot be written: {error.strerror}") from error
    return log, summary


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
