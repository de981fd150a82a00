"""`export`: session logs in the formats of other programs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from tams_app.errors import ConfigError

if TYPE_CHECKING:
    from rich.console import Console

Export: TypeAlias = Callable[[Sequence[Path], Path | None, "Console"], None]
"""Writes logs into a folder (None: its default)."""


def export(
    logs: Annotated[list[Path], typer.Argument(metavar="SESSION...", help="Session folders.")],
    kind: Annotated[
        str,
        typer.Option(
            "--format",
            help="rosbag2 (ROS 2; a bag for each session).",
            autocompletion=lambda: list(FORMATS),
        ),
    ],
    out: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Where to; by default in each session's own.")
    ] = None,
) -> None:
    """Write session logs in the format of another program; the logs stay as they are."""
    from rich.console import Console

    from tams_app.console.report import session_log

    if kind not in FORMATS:
        raise ConfigError(f"--format: {kind!r} is none of {', '.join(FORMATS)}")
    FORMATS[kind]([session_log(log) for log in logs], out, Console())


def _rosbag2(logs: Sequence[Path], out: Path | None, console: Console) -> None:
    """DIR/<session> for each, or rosbag2/ in its folder."""
    from tams_app.ros2.extra import require_extra

    require_extra("--format rosbag2")
    from tams_app.export.rosbag2 import write_bag
    from tams_app.session.viewing import scene_of_header

    for log in logs:
        bag = log.parent / "rosbag2" if out is None else out / log.parent.resolve().name
        counts = write_bag(log, bag, scene_of_header)
        topics = sum(count > 0 for count in counts.values())
        console.print(
            f"{bag}: {sum(counts.values())} messages on {topics} topics",
            markup=False,
            highlight=False,
            soft_wrap=True,
        )


FORMATS: dict[str, Export] = {"rosbag2": _rosbag2}
