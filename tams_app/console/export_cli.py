"""`export`: session logs in the formats of other programs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, TypeAlias

import typer

from tams_app.errors import ConfigError, require_extra
from tams_app.export.options import ExportOptions
from tams_app.registry import Registry

if TYPE_CHECKING:
    from tams_app.printing import Console

Export: TypeAlias = Callable[[Sequence[Path], Path | None, ExportOptions, "Console"], None]
"""Writes session logs (`session.mcap`, one of each session) in another program's format.

Its arguments: the logs; the folder to write to, None for a default beside them; what is to be
written of them; a console for the lines of the result. It raises `ConfigError` for arguments that
it cannot use.
"""


def export(
    logs: Annotated[list[Path], typer.Argument(metavar="SESSION", help="Session folders.")],
    kind: Annotated[
        str,
        typer.Option(
            "--format",
            help="rosbag2 (one ROS 2 bag per session) or lerobot (LeRobotDataset v3.0: one episode "
            "per session, or each of its kept episodes).",
            autocompletion=lambda: list(FORMATS),
        ),
    ],
    out: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder to write to; default in the session's folder."),
    ] = None,
    task: Annotated[str, typer.Option(help="lerobot: the task, in words.")] = ExportOptions.task,
    only_success: Annotated[
        bool, typer.Option("--only-success", help="lerobot: leave out unsuccessful episodes.")
    ] = False,
    keep_idle: Annotated[
        bool,
        typer.Option(
            "--keep-idle",
            help="lerobot: keep the time before the arm first moves and after the block is placed.",
        ),
    ] = False,
    with_damaged: Annotated[
        bool,
        typer.Option(
            "--with-damaged",
            help="lerobot: from a damaged or cut-off log, export the longest intact part.",
        ),
    ] = False,
) -> None:
    """Convert session logs to rosbag2 or a LeRobot dataset."""
    from tams_app.console.report import session_log
    from tams_app.printing import Console

    options = ExportOptions(task, only_success, keep_idle, with_damaged)
    FORMATS[kind]([session_log(log) for log in logs], out, options, Console())


def _rosbag2(
    logs: Sequence[Path], out: Path | None, _options: ExportOptions, console: Console
) -> None:
    """DIR/<session> for each, or rosbag2/ in its folder."""
    require_extra("ros2", "--format rosbag2")
    from tams_app.export.rosbag2 import write_bag
    from tams_app.recording import damage_of, read_records
    from tams_app.session.viewing import scene_of_header

    for log in logs:
        bag = log.parent / "rosbag2" if out is None else out / log.parent.resolve().name
        _, header = next(read_records(log))
        counts = write_bag(log, bag, scene_of_header(header))
        topics = sum(count > 0 for count in counts.values())
        console.print(f"{bag}: {sum(counts.values())} messages on {topics} topics", soft_wrap=True)
        if damage := damage_of(log):
            console.print(f"{bag}: {damage}", soft_wrap=True)


def _lerobot(
    logs: Sequence[Path], out: Path | None, options: ExportOptions, console: Console
) -> None:
    """DIR for all of them together, or lerobot/ in the folder of the only one."""
    from tams_app.export.lerobot.convert import export_lerobot

    if out is None and len(logs) > 1:
        raise ConfigError("--out: of several sessions say in which folder the dataset is to be")
    folder = out or logs[0].parent / "lerobot"
    episodes = export_lerobot(logs, folder, options, console)
    rows = sum(episode.rows for episode in episodes)
    views = ", ".join(episodes[0].shape.views)
    number = "1 episode" if len(episodes) == 1 else f"{len(episodes)} episodes"
    skipped = len(logs) - len({episode.path for episode in episodes})
    left_out = f"; skipped: {skipped} of {len(logs)} sessions" if skipped else ""
    console.print(f"{folder}: {number}, {rows} frames of {views}{left_out}", soft_wrap=True)


FORMATS: Registry[Export] = Registry(
    "--format", "tams.exports", {"rosbag2": _rosbag2, "lerobot": _lerobot}
)
"""Exports by their word for `--format`; entry points of `tams.exports`."""
