"""The results of a session for people: summary.json, figure, page, and the table at its end."""

from __future__ import annotations

import os
import shlex
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

from tams_app.console.summary_tables import link_table, seen_tables, summary_tables
from tams_app.errors import UnreadableLogError
from tams_app.link.messages import (
    OPERATOR_FACT,
    OPERATOR_FOLDER_FACT,
    ROBOT_FOLDER_FACT,
    SESSION_FACT,
)
from tams_app.printing import Console, waiting
from tams_app.recording import LOG_NAME, SessionLog, damage_sentence, read_log
from tams_app.recording.reader import ShownPicture, read_pictures
from tams_app.summary.joined import (
    clock_offsets,
    in_order,
    joined,
    on_robots_clock,
    summarise_joined,
)
from tams_app.summary.summarise import save_summary, session_summary
from tams_app.summary.tables import LogTables

FIGURE_NAME = "bitrates.png"
PAGE_NAME = "report.html"
_OTHERS_FOLDER = {  # by whether a log is the robot's: the fact, and what stands for it without
    True: (OPERATOR_FOLDER_FACT, "FOLDER_OF_OPERATE"),
    False: (ROBOT_FOLDER_FACT, "FOLDER_OF_ROBOT"),
}
_WRITING = "writing summary and report"


def report_session(
    folder: Path, console: Console, progress: Console | None = None
) -> dict[str, Any]:
    """Write summary, figure and page from the log in `folder`; show the summary, return it.

    `folder` may name the log itself. `progress`: where it is reported that this takes its time, in
    place of `console`. UnreadableLogError if there is no log, or none of ours; LogError if the
    folder cannot be written.
    """
    folder = _session_folder(folder)
    with waiting(_WRITING, progress or console):
        log, summary = _summarised(folder)
    _show(summary, folder, console, join_command(log, folder))
    return summary


def report_both(
    first: Path, second: Path, console: Console, progress: Console | None = None
) -> dict[str, Any]:
    """Report on the two logs of one session, in the folder of the robot's side."""
    folders = [_session_folder(one) for one in (first, second)]
    with waiting(_WRITING, progress or console):
        logs = [read_log(folder / LOG_NAME) for folder in folders]
        robot, operator = in_order(*logs)
        of_robot, of_operator = folders if operator is logs[1] else reversed(folders)
        offsets = clock_offsets(robot, operator)
        both = LogTables(joined(robot, operator, offsets))
        summary = summarise_joined(robot, operator, offsets, both)
        save_summary(summary, of_robot)
        shown = read_pictures(of_operator / LOG_NAME)
        pictures = on_robots_clock(shown, robot.header, operator.header, offsets)
        _draw(both, summary, pictures, of_robot)
    _show(summary, of_robot, console)
    return summary


def _show(summary: Mapping[str, Any], folder: Path, console: Console, join: str = "") -> None:
    of_operator = "seen" in summary
    console.print(seen_tables(summary) if of_operator else summary_tables(summary, bool(join)))
    if "link" in summary:  # of two sides
        console.print(link_table(summary["link"]))
    if not summary["complete"]:
        missing = [(gap["start_s"], gap["end_s"]) for gap in summary["missing"]]
        damage = damage_sentence(missing) or "The operator's log is damaged or ends early."
        console.print(damage, style="bold", soft_wrap=True)
    lines = [
        f"report: {folder / PAGE_NAME}",
        f"replay: run_tams.py replay {shlex.quote(str(folder))}",
    ]
    if join:
        lines.append(f"report on both sides{_to_replace(join)}: {join}")
    for line in lines:
        console.print(line, style="bold", soft_wrap=True, no_wrap=True)


def join_command(log: SessionLog, folder: Path) -> str:
    """The command that joins a log with that of the other side.

    The other folder, whose name was exchanged when the link began, is looked for beside this one.
    "" for the log of a session on one computer.
    """
    facts = log.facts
    if SESSION_FACT not in facts:
        return ""
    is_robot = OPERATOR_FACT not in facts
    fact, unknown = _OTHERS_FOLDER[is_robot]
    name = Path(facts.get(fact, "")).name
    other = str(folder.parent / name) if name else unknown
    both = (str(folder), other) if is_robot else (other, str(folder))
    return shlex.join(["run_tams.py", "report", *both])


def _to_replace(join: str) -> str:
    """The words for what is still to be put into the command of `join_command`."""
    return "".join(
        f" (replace {unknown} by its folder, copied here)"
        for _, unknown in _OTHERS_FOLDER.values()
        if unknown in join
    )


def write_summary(folder: Path) -> dict[str, Any]:
    """Compute summary.json, bitrates.png and report.html from the log in `folder`, show nothing."""
    return _summarised(folder)[1]


def _summarised(folder: Path) -> tuple[SessionLog, dict[str, Any]]:
    tables = LogTables(read_log(folder / LOG_NAME))
    summary = session_summary(tables)
    save_summary(summary, folder)
    _draw(tables, summary, read_pictures(folder / LOG_NAME), folder)
    return tables.log, summary


def _draw(
    tables: LogTables, summary: Mapping[str, Any], pictures: Iterable[ShownPicture], folder: Path
) -> None:
    """Write figure and page into `folder`; LogError if they cannot be written."""
    # matplotlib and jinja2: no session starts with them
    from tams_app.report.figures import bitrates_figure
    from tams_app.report.plots import save_figure
    from tams_app.report.session_page import write_page

    save_figure(bitrates_figure(tables), folder / FIGURE_NAME)
    write_page(tables, summary, pictures, folder / PAGE_NAME)


def session_log(given: Path) -> Path:
    """The log in a session's folder, or the log itself; UnreadableLogError if there is none."""
    return _session_folder(given) / LOG_NAME


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
