"""`export`: logs in the formats of other programs."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Annotated, TypeAlias

import typer

from tams_app.errors import ConfigError

Export: TypeAlias = Callable[[Sequence[Path], Path | None], Iterator[str]]
"""Writes sessions (their folders) to a folder, if one is given; a sentence for each result."""


def add_export(app: typer.Typer) -> None:
    """Give `app` the command."""
    app.command()(export)


def export(
    logs: Annotated[list[Path], typer.Argument(metavar="LOG…", help="Session folders.")],
    to: Annotated[
        str,
        typer.Option(
            "--format",
            help="rosbag2 (ROS 2; a bag for each session).",
            autocompletion=lambda: list(FORMATS),
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Where to; default: beside each session's log."),
    ] = None,
) -> None:
    """Write the logs of sessions in a format of other programs; the logs stay as they are."""
    if to not in FORMATS:
        raise ConfigError(f"--format: {to!r} is none of {', '.join(FORMATS)}")
    for sentence in FORMATS[to](logs, out):
        typer.echo(sentence)


def _rosbag2(logs: Sequence[Path], out: Path | None) -> Iterator[str]:
    """DIR/<session> for each, or rosbag2/ in its folder."""
    from tams_app.console.report import session_log
    from tams_app.ros2.extra import require_extra

    require_extra("--format rosbag2")
    from tams_app.export.rosbag2 import write_bag
    from tams_app.session.viewing import scene_of_header

    found = [session_log(log) for log in logs]  # all are looked for before one is written
    for log in found:
        folder = log.parent
        bag = folder / "rosbag2" if out is None else out / folder.resolve().name
        counts = write_bag(log, bag, scene_of_header)
        topics = sum(count > 0 for count in counts.values())
        yield f"{bag}: {sum(counts.values())} messages on {topics} topics"


FORMATS: dict[str, Export] = {"rosbag2": _rosbag2}
