"""What a session leaves for people: summary.json, the figure of the bitrates, a table."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from tams_app.console.table import summary_tables
from tams_app.errors import LogError, UnreadableLogError
from tams_app.recording import read_log
from tams_app.session.recorders import LOG_NAME
from tams_app.summary.file import save_summary

FIGURE_NAME = "bitrates.png"


def report_session(folder: Path, console: Console | None = None) -> None:
    """Compute summary.json and bitrates.png from the log in `folder` and show the summary.

    `folder` may name the log itself. UnreadableLogError if there is no log,
    or none of ours; LogError if the folder cannot be written.
    """
    folder = _session_folder(folder)
    summary = write_summary(folder)
    console = console or Console()
    console.print(summary_tables(summary))
    if missing := _missing(summary):
        console.print(missing, style="bold", highlight=False, soft_wrap=True)
    console.print(f"[bold]{folder}[/]", highlight=False)


def write_summary(folder: Path) -> dict[str, Any]:
    """Compute summary.json and bitrates.png from the log in `folder`, and show nothing."""
    from tams_app.study.figures import save_bitrates  # matplotlib: no session starts with it

    log = read_log(folder / LOG_NAME)
    summary = save_summary(log, folder)
    try:
        save_bitrates(log, folder / FIGURE_NAME)
    except OSError as error:
        raise LogError(f"{folder}: the figure cannot be written: {error.strerror}") from error
    return summary


def _session_folder(given: Path) -> Path:
    if os.path.isfile(given):
        if given.name != LOG_NAME:
            raise UnreadableLogError(
                f"{given}: is not a session: give the folder that holds {LOG_NAME}"
            )
        return given.parent
    if not os.path.isdir(given):
        raise UnreadableLogError(f"{given}: there is no such folder: give a session folder")
    if not os.path.isfile(given / LOG_NAME):
        raise UnreadableLogError(f"{given}: holds no {LOG_NAME}: give a session folder")
    return given


def _missing(summary: Mapping[str, Any]) -> str:
    """What the log lacks, in one sentence; empty if it is whole."""
    if summary["complete"]:
        return ""
    lost = [gap for gap in summary["missing"] if gap["end_s"] is not None]
    if not lost:
        return (
            "The log ends early (the session was killed, the disk was full, or the file was cut or "
            "damaged): these figures cover only what was written before."
        )
    times = ", ".join(f"{gap['start_s']:.1f} to {gap['end_s']:.1f} s" for gap in lost)
    return f"The log is damaged: these figures are without what was recorded at {times}."
