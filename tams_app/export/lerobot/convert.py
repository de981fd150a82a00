"""Conversion of session logs to a dataset in a new folder; a failed one leaves no folder."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from contextlib import closing
from pathlib import Path

from rich.progress import Progress

from tams_app.errors import ConfigError, LogError, UnreadableLogError, require_extra
from tams_app.export.lerobot.episode import EpisodeSource, read_episodes
from tams_app.export.options import ExportOptions
from tams_app.outputs import refuse_existing
from tams_app.printing import Console


def export_lerobot(
    logs: Sequence[Path], out: Path, options: ExportOptions, console: Console
) -> Sequence[EpisodeSource]:
    """Write the logs as a LeRobotDataset v3.0 into the new folder `out`.

    Each is an episode; a session with episodes gives the kept ones. Of several logs, those that
    give no episode are left out, and named. UnreadableLogError if no log gives one, ConfigError if
    logs do not fit together or `out` is there already, LogError if it cannot be written, SetupError
    if a package is missing; then no folder is left.
    """
    require_extra("export", "--format lerobot")
    from tams_app.export.lerobot.dataset import write_dataset

    refuse_existing(out)
    # a bar of the frames written, of all views together; on no terminal the sentences alone
    with Progress(console=console, transient=True, disable=not console.is_terminal) as progress:
        bar = progress.add_task("frames", total=None)  # while the logs are read
        episodes = _read(logs, out, options, console)
        progress.update(bar, total=sum(one.rows * len(one.shape.views) for one in episodes))
        try:
            out.mkdir(parents=True)
        except OSError as error:
            raise LogError(f"{out}: cannot be made: {error.strerror}") from error
        try:
            with closing(write_dataset(out, episodes, options.task)) as frames:
                for _ in frames:
                    progress.advance(bar)
        except BaseException as error:
            shutil.rmtree(out, ignore_errors=True)
            if isinstance(error, OSError):
                raise LogError(f"{out}: cannot be written: {error.strerror or error}") from error
            raise
    return episodes


def _read(
    logs: Sequence[Path], out: Path, options: ExportOptions, console: Console
) -> list[EpisodeSource]:
    """The episodes, which have one shape, with a sentence on each that is left out or not whole."""
    episodes: list[EpisodeSource] = []
    for path in logs:
        try:
            found, sentence = read_episodes(path, options)
        except UnreadableLogError as error:
            if len(logs) == 1:
                raise
            found, sentence = [], f"skipped: {error}"
        episodes += found
        if sentence:
            console.print(sentence, soft_wrap=True)
    if not episodes:
        raise UnreadableLogError(f"{out}: none of {len(logs)} sessions can be exported")
    _check_alike(episodes)
    for episode in episodes:
        if episode.remark:
            console.print(episode.remark, soft_wrap=True)
    return episodes


def _check_alike(episodes: Sequence[EpisodeSource]) -> None:
    first = episodes[0]
    for other in episodes[1:]:
        if other.shape != first.shape:
            differs = f"has {other.shape}, but {first.path.parent} has {first.shape}"
            if other.shape._replace(arm=first.shape.arm) == first.shape:
                differs = f"is of another arm than {first.path.parent}"
            raise ConfigError(f"{other.path.parent}: {differs}: export them apart")
