"""Conversion of session logs to a dataset in a new folder; a failed one leaves no folder."""

from __future__ import annotations

import shutil
from collections.abc import Callable, Sequence
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path
from typing import Protocol

from tams_app.errors import ConfigError, LogError, SetupError, UnreadableLogError
from tams_app.export.lerobot.episode import Episode, read_episodes
from tams_app.export.options import ExportOptions
from tams_app.outputs import refuse_existing

_NEEDS = ("pandas", "pyarrow")


class Watcher(Protocol):
    """A receiver of the export's progress."""

    def notify(self, text: str) -> None:
        """A sentence for the user."""

    def begin(self, frames: int) -> None:
        """The export will write this many frames, summed over all views."""

    def frame(self) -> None:
        """One frame has been written."""


def export_lerobot(
    logs: Sequence[Path], out: Path, options: ExportOptions, watcher: Watcher
) -> Sequence[Episode]:
    """Write the logs as a LeRobotDataset v3.0 into the new folder `out`.

    Each is an episode; a session with episodes gives the kept ones. Of several logs,
    those that give no episode are left out, and named. Returns the episodes.
    UnreadableLogError if no log gives one, ConfigError if logs do not fit together or `out` is
    there already, LogError if it cannot be written, SetupError if a package is missing; then no
    folder is left.
    """
    if missing := [name for name in _NEEDS if find_spec(name) is None]:
        raise SetupError(f"{', '.join(missing)} missing: pip install 'tams[study]'")
    refuse_existing(out)
    episodes: list[Episode] = []
    for path in logs:
        try:
            episodes += read_episodes(path, options, watcher.notify)
        except UnreadableLogError as error:
            if len(logs) == 1:
                raise
            watcher.notify(f"skipped: {error}")
    if not episodes:
        raise UnreadableLogError(f"{out}: none of {len(logs)} sessions can be exported")
    _check_alike(episodes)
    for episode in episodes:
        if episode.remark:
            watcher.notify(episode.remark)
    watcher.begin(sum(one.rows * len(one.shape.views) for one in episodes))
    try:
        out.mkdir(parents=True)
    except OSError as error:
        raise LogError(f"{out}: cannot be made: {error.strerror}") from error
    try:
        _write(episodes, out, options.task, watcher.frame)
    except OSError as error:
        shutil.rmtree(out, ignore_errors=True)
        raise LogError(f"{out}: cannot be written: {error.strerror or error}") from error
    except BaseException:
        shutil.rmtree(out, ignore_errors=True)
        raise
    return episodes


def _check_alike(episodes: Sequence[Episode]) -> None:
    first = episodes[0]
    for other in episodes[1:]:
        if other.shape != first.shape:
            raise ConfigError(
                f"{other.path.parent}: has {other.shape}, but {first.path.parent} has "
                f"{first.shape}: export them apart"
            )
        if _arm(other) != _arm(first):
            raise ConfigError(
                f"{other.path.parent}: is of another arm than {first.path.parent}: "
                "export them apart"
            )


def _write(episodes: Sequence[Episode], out: Path, task: str, on_frame: Callable[[], None]) -> None:
    from tams_app.export.lerobot.dataset import DatasetWriter  # pyarrow and pandas are an extra

    with closing(DatasetWriter(out, episodes[0].shape, task)) as dataset:
        for episode in episodes:
            dataset.add(episode, on_frame)
        dataset.finish(_arm(episodes[0]))


def _arm(episode: Episode) -> str | None:
    """The arm's model; logs of version 0.1 do not name it."""
    model = episode.header.config.get("arm", {}).get("model")
    return None if model is None else str(model)
