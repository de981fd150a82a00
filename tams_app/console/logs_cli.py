"""The commands for sessions that are over: `report`, `replay`, `export` and `log`."""

from __future__ import annotations

import inspect
import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from tams_app.console.options import JsonOption
from tams_app.errors import ConfigError, LogError, not_one_of
from tams_app.outputs import refuse_existing

if TYPE_CHECKING:
    from tams_app.recording.topics import Topic

_HEAD = """\
# The fields of the log

Every field of each topic whose messages are JSON, made from the records in `tams_app/records/`,
`tams_app/recording/topics.py` and `tams_app/recording/rates.py` by `run_tams.py log fields`.
[LOG.md](LOG.md#topics) says what a topic has a message for, and the conventions of units, frames
and clocks. *By name*: an object with a value for each name, such as each view. Fields behind a dot
are those of the object, or of each object of the list.
"""
_WORDS = {
    "integer": "whole number",
    "number": "number",
    "boolean": "true, false",
    "string": "text",
    "object": "object",
}

log_app = typer.Typer(
    no_args_is_help=True, rich_markup_mode=None, help="List and read session logs."
)


def _topics() -> list[str]:
    from tams_app.recording.topics import TOPICS

    return [topic.name for topic in TOPICS.values()]


SessionArgument = Annotated[Path, typer.Argument(metavar="SESSION", help="A session folder.")]
TopicArgument = Annotated[
    str,
    typer.Argument(help="Such as /phase; docs/LOG.md lists all topics.", autocompletion=_topics),
]


def report(
    log: Annotated[Path, typer.Argument(help="A session folder.")],
    other: Annotated[
        Path | None,
        typer.Argument(help="The other computer's session folder; either order."),
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Recreate summary.json, report.html and bitrates.png from a log.

    For a log that is damaged or cut off, summary.json has "complete": false and what is missing; an
    earlier complete one is kept as summary.json.before. Given the folders of `robot` and `operate`,
    the report also covers the frames as they were shown, and the link; it is written to the folder
    of `robot`.
    """
    from tams_app.console.report import report_both, report_session
    from tams_app.printing import Console

    consoles = Console(quiet=as_json), Console(stderr=as_json)
    summary = (
        report_session(log, *consoles) if other is None else report_both(log, other, *consoles)
    )
    if as_json:
        typer.echo(json.dumps(summary))


def replay(
    log: Annotated[Path, typer.Argument(help="A session folder.")],
    speed: Annotated[float, typer.Option(help="Playback speed; 1 is real time.")] = 1.0,
    headless: Annotated[bool, typer.Option("--headless", help="Open no window.")] = False,
    mark: Annotated[
        bool,
        typer.Option("--mark", help="Mark by keys where each phase begins, for calibrate phases."),
    ] = False,
) -> None:
    """Play back a session from its log; the arm does not move."""
    from tams_app.console.replay.run import run_replay

    run_replay(log, speed, headless, mark)


@log_app.command("list")
def list_sessions(
    directory: Annotated[
        Path, typer.Argument(metavar="DIR", help="The folder that holds the session folders.")
    ] = Path("logs"),
    as_json: JsonOption = False,
) -> None:
    """List the sessions in a folder and their outcomes."""
    from rich.table import Table

    from tams_app.printing import Console

    sessions = list(_sessions(directory))
    if as_json:
        typer.echo(json.dumps(sessions))
        return
    if not sessions:
        typer.echo(f"{directory}: there is no session in it")
        return
    table = Table(box=None, pad_edge=False)
    for column in ("session", "s", "strategy", "network", "outcome", "stops"):
        table.add_column(column, no_wrap=column == "session")
    for session in sessions:
        table.add_row(*(_cell(value) for value in session.values()))
    Console().print(table)


@log_app.command()
def show(
    session: SessionArgument,
    topic: Annotated[
        str,
        typer.Option(
            help="Print this topic's messages, one JSON object per line.", autocompletion=_topics
        ),
    ] = "",
    as_json: JsonOption = False,
) -> None:
    """List a log's topics with their messages, size and times."""
    from dataclasses import asdict

    from rich.table import Table

    from tams_app.console.report import session_log
    from tams_app.printing import Console
    from tams_app.recording.tables import messages_of, topic_counts

    path = session_log(session)
    if topic:
        for message in messages_of(path, topic):
            typer.echo(json.dumps(message))
        _show_damage(path)
        return
    counts = topic_counts(path)
    _show_damage(path)
    if as_json:
        typer.echo(json.dumps([asdict(count) for count in counts]))
        return
    table = Table(box=None, pad_edge=False)
    table.add_column("topic")
    for column in ("messages", "kB", "first s", "last s"):
        table.add_column(column, justify="right")
    for count in counts:
        size_kb, first, last = count.size_bytes / 1000, count.first_s, count.last_s
        table.add_row(
            count.topic, str(count.messages), f"{size_kb:.1f}", f"{first:.2f}", f"{last:.2f}"
        )
    Console().print(table)


@log_app.command()
def fields(
    topic: Annotated[
        str, typer.Argument(metavar="[TOPIC]", help="Such as /tick.", autocompletion=_topics)
    ] = "",
) -> None:
    """Print what each field of a topic means, or of all topics."""
    typer.echo(_reference(topic), nl=False)


@log_app.command("csv")
def to_csv(
    session: SessionArgument,
    topic: TopicArgument,
    out: Annotated[Path | None, typer.Option(help="Default: standard output.")] = None,
) -> None:
    """Write one topic of a log as CSV, nested fields as columns."""
    from tams_app.console.report import session_log
    from tams_app.recording.tables import columns_of, write_csv

    path = session_log(session)
    if out is not None:
        refuse_existing(out)
    columns = columns_of(path, topic)
    _show_damage(path)
    if out is None:
        from tams_app.printing import PlainOutput

        write_csv(path, topic, columns, PlainOutput(sys.stdout))
        return
    try:
        with out.open("x", encoding="utf-8", newline="") as file:
            rows = write_csv(path, topic, columns, file)
    except OSError as error:
        raise LogError(f"{out}: cannot be written: {error.strerror}") from error
    typer.echo(f"{out}: {rows} rows")


def _show_damage(path: Path) -> None:
    """Print it on standard error: another program may read the output."""
    from tams_app.recording import damage_of

    if damage := damage_of(path):
        typer.echo(damage, err=True)


def _sessions(directory: Path) -> Iterator[dict[str, Any]]:
    """Every folder with a log, by name, which begins with its time."""
    from tams_app.recording import LOG_NAME

    try:
        folders = sorted(folder for folder in directory.iterdir() if (folder / LOG_NAME).is_file())
    except OSError as error:
        raise LogError(f"{directory}: cannot be read: {error.strerror}") from error
    for folder in folders:
        summary = _summary(folder)
        arm, outcome = _part(summary, "arm"), _part(summary, "outcome")
        stops = None if "seen" in summary else arm.get("stops")  # the robot's side knows them
        yield {
            "session": folder.name,
            "duration_s": summary.get("duration_s"),
            "strategy": summary.get("strategy"),
            "network": summary.get("network"),
            "outcome": _outcome(outcome) if summary else "no summary: run report",
            "stops": len(stops) if isinstance(stops, list) else None,
        }


def _summary(folder: Path) -> dict[str, Any]:
    try:
        found = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def _part(summary: dict[str, Any], name: str) -> dict[str, Any]:
    """A section of a summary, empty where it is none of ours."""
    found = summary.get(name)
    return found if isinstance(found, dict) else {}


def _outcome(outcome: dict[str, Any]) -> str:
    time_s = outcome.get("completion_time_s")
    if outcome.get("success") and isinstance(time_s, int | float):
        return f"placed after {time_s:.1f} s"
    return str(outcome.get("reason") or "not judged")


def _cell(value: Any) -> str:
    if value is None:
        return "–"
    return f"{value:.0f}" if isinstance(value, float) else str(value)


def _reference(topic: str = "") -> str:
    """The reference of the log's fields, from the records; ConfigError for an unknown topic."""
    from tams_app.recording.rates import RATES
    from tams_app.recording.topics import TOPICS

    topics = {topic.name: topic for topic in (*TOPICS.values(), RATES)}
    if topic:
        if topic not in topics:
            raise ConfigError(f"TOPIC: {not_one_of(topic, topics)}")
        return _fields_table(topics[topic])
    return "\n".join([_HEAD, *map(_fields_table, topics.values())])


def _fields_table(topic: Topic[Any]) -> str:
    rows = [
        f"| `{name}` | {_type(part)} | {part['description']} |"
        for name, part in _fields(json.loads(topic.schema()))
    ]
    about = " ".join((inspect.getdoc(topic.record_type) or "").split("\n\n")[0].split())
    columns = "| Field | Type | Meaning |\n|---|---|---|"
    return "\n".join([f"## `{topic.name}`", "", about, "", columns, *rows, ""])


def _fields(schema: dict[str, Any], before: str = "") -> Iterator[tuple[str, dict[str, Any]]]:
    """Each field with its dotted name, an object's own behind it."""
    for name, part in schema.get("properties", {}).items():
        yield before + name, part
        yield from _fields(part.get("items", part), f"{before}{name}.")


def _type(schema: dict[str, Any]) -> str:
    if items := schema.get("items"):
        return f"list: {_type(items)}"
    if values := schema.get("additionalProperties"):
        return f"by name: {_type(values)}"
    if values := schema.get("enum"):
        return ", ".join(f"`{value}`" if value else "empty" for value in values)
    return _WORDS[schema["type"]]
