"""Conversion of session logs to a dataset in a new folder; a failed one leaves no folder."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path

from rich.progress import Progress

from tams_app.errors import ConfigError, LogError, UnreadableLogError, require_extra
from tams_app.export.lerobot.episode import EpisodeSource, read_episodes
from tams_app.export.options import ExportOptions
from tams_app.outputs import refuse_existing
from tams_app.printing import Console


class ExportProgress(Progress):
    """A bar of the frames written; on no terminal the sentences alone."""

    def __init__(self, console: Console) -> None:
        super().__init__(console=console, transient=True, disable=not console.is_terminal)
        self._frames = self.add_task("frames", total=None)  # while the logs are read

    def notify(self, text: str) -> None:
        self.console.print(text, soft_wrap=True)

    def begin(self, frames: int) -> None:
        """Of all views together."""
        self.update(self._frames, total=frames)

    def frame(self) -> None:
        self.advance(self._frames)


def export_lerobot(
    logs: Sequence[Path], out: Path, options: ExportOptions, progress: ExportProgress
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
    episodes: list[EpisodeSource] = []
    for path in logs:
        try:
            episodes += read_episodes(path, options, progress.notify)
        except UnreadableLogError as error:
            if len(logs) == 1:
                raise
            progress.notify(f"skipped: {error}")
    if not episodes:
        raise UnreadableLogError(f"{out}: none of {len(logs)} sessions can be exported")
    _check_alike(episodes)
    for episode in episodes:
        if episode.remark:
            progress.notify(episode.remark)
    progress.begin(sum(one.rows * len(one.shape.views) for one in episodes))
    try:
        out.mkdir(parents=True)
    except OSError as error:
        raise LogError(f"{out}: cannot be made: {error.strerror}") from error
    try:
        write_dataset(out, episodes, options.task, progress.frame)
    except BaseException as error:
        shutil.rmtree(out, ignore_errors=True)
        if isinstance(error, OSError):
            raise LogError(f"{out}: cannot be written: {error.strerror or error}") from error
        raise
    return episodes


def _check_alike(episodes: Sequence[EpisodeSource]) -> None:
    first = episodes[0]
    for other in episodes[1:]:
        if other.shape != first.shape:
            differs = f"has {other.shape}, but {first.path.parent} has {first.shape}"
            if other.shape._replace(arm=first.shape.arm) == first.shape:
                differs = f"is of another arm than {first.path.parent}"
            raise ConfigError(f"{other.path.parent}: {differs}: export them apart")
