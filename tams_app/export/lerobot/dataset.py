"""Writes a dataset, episode after episode; `meta/info.json` comes last."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq

from tams_app.export.lerobot import layout
from tams_app.export.lerobot.episode import Episode, Shape
from tams_app.export.lerobot.files import DataFiles, VideoFiles
from tams_app.export.lerobot.layout import FileNumber, video_key
from tams_app.export.lerobot.samples import PHASES
from tams_app.export.lerobot.statistics import Statistics, as_lists, merged, statistics_of
from tams_app.outputs import write_file

_SESSION_TYPES = {
    "session_episode": pa.int64(),
    "success": pa.bool_(),
    "completed": pa.bool_(),
    "completion_time_s": pa.float64(),
    "drops": pa.int64(),
}  # which may be null in every episode


class DatasetWriter:
    """A dataset in the folder `root`, whose episodes have one `shape` and one `task`.

    Errors of the file system are OSError, those of GStreamer's part of it LogError.
    """

    def __init__(self, root: Path, shape: Shape, task: str) -> None:
        self._root = root
        self._shape = shape
        self._task = task
        self._rows = 0
        self._episodes: list[dict[str, Any]] = []
        self._statistics: list[dict[str, Statistics]] = []
        self._data = DataFiles(root, shape)
        self._videos = {view: VideoFiles(root, shape, view) for view in shape.views}

    def add(self, episode: Episode, on_frame: Callable[[], None]) -> None:
        """Append an episode; `on_frame` is called for each frame of each view."""
        columns = self._columns(episode)
        statistics = {
            name: statistics_of(column) for name, column in columns.items() if name != "phase"
        }
        where: dict[str, float] = {
            f"data/{name}": value for name, value in self._data.append(columns).items()
        }
        for view, video in self._videos.items():
            key = video_key(view)
            placed, statistics[key] = video.append(episode, on_frame)
            where |= {f"videos/{key}/{name}": value for name, value in placed.items()}
        self._episodes.append(
            {
                "episode_index": len(self._episodes),
                "tasks": [self._task],
                "length": episode.rows,
                "dataset_from_index": self._rows,
                "dataset_to_index": self._rows + episode.rows,
                **where,
                "meta/episodes/chunk_index": 0,
                "meta/episodes/file_index": 0,
                **_session_of(episode),
                **{
                    f"stats/{feature}/{name}": value
                    for feature, found in as_lists(statistics).items()
                    for name, value in found.items()
                },
            }
        )
        self._statistics.append(statistics)
        self._rows += episode.rows

    def finish(self, robot_type: str | None) -> None:
        """Close all files and write what describes them."""
        for video in self._videos.values():
            video.close()
        self._data.close()
        episodes = pa.Table.from_pylist(self._episodes)
        for name, kind in _SESSION_TYPES.items():
            column = episodes.column(name).cast(kind)
            episodes = episodes.set_column(episodes.column_names.index(name), name, column)
        pq.write_table(episodes, FileNumber().path(self._root, layout.EPISODES_PATH))
        _write_names(self._root / layout.TASKS_PATH, "task", [self._task])
        _write_names(self._root / layout.SUBTASKS_PATH, "subtask", list(PHASES))
        statistics = {
            feature: merged([one[feature] for one in self._statistics])
            for feature in self._statistics[0]
        }
        _write_json(self._root / layout.STATISTICS_PATH, as_lists(statistics))
        _write_json(self._root / layout.INFO_PATH, self._info(robot_type))

    def close(self) -> None:
        """Let go of all files, finished or not; may be called twice."""
        self._data.close()
        for video in self._videos.values():
            video.abandon()

    def _columns(self, episode: Episode) -> dict[str, Any]:
        samples, number = episode.samples, np.arange(episode.rows)
        return {
            "observation.state": samples.state,
            "action": samples.action,
            "phase": [PHASES[place].value for place in samples.phase],
            "subtask_index": samples.phase,
            "engaged": samples.engaged,
            "timestamp": (number / self._shape.fps).astype(np.float32),
            "frame_index": number,
            "episode_index": np.full(episode.rows, len(self._episodes)),
            "index": self._rows + number,
            "task_index": np.zeros(episode.rows, np.int64),
        }

    def _info(self, robot_type: str | None) -> dict[str, Any]:
        return {
            "codebase_version": layout.VERSION,
            "robot_type": robot_type,
            "total_episodes": len(self._episodes),
            "total_frames": self._rows,
            "total_tasks": 1,
            "chunks_size": layout.FILES_PER_CHUNK,
            "data_files_size_in_mb": self._file_mb("parquet", layout.DATA_FILE_MB),
            "video_files_size_in_mb": self._file_mb("mp4", layout.VIDEO_FILE_MB),
            "fps": self._shape.fps,
            "splits": {"train": f"0:{len(self._episodes)}"},
            "data_path": layout.DATA_PATH,
            "video_path": layout.VIDEO_PATH,
            "features": layout.features(self._shape),
        }

    def _file_mb(self, kind: str, usual: int) -> int:
        """What no file of that kind is above; more than usual where one episode alone is."""
        largest = max(path.stat().st_size for path in self._root.rglob(f"*.{kind}"))
        return max(usual, -(-largest // layout.MB))


def _session_of(episode: Episode) -> dict[str, Any]:
    """The log's facts of the whole episode."""
    header, outcome = episode.header, episode.outcome
    return {
        "session": episode.name,
        "session_episode": episode.number,
        "log_complete": not episode.remark,
        "success": outcome.success,
        "completed": outcome.completed,
        "completion_time_s": outcome.completion_time_s,
        "drops": outcome.drops,
        "outcome": outcome.reason,
        "strategy": header.strategy,
        "network": header.network,
        "seed": header.seed,
        "started_wall_ns": episode.start_ns + header.wall_offset_ns,
    }


def _write_names(path: Path, kind: str, names: list[str]) -> None:
    """A table from name to number, the names being its index."""
    index = pd.Index(names, name=kind)
    pd.DataFrame({f"{kind}_index": range(len(names))}, index=index).to_parquet(path)


def _write_json(path: Path, content: dict[str, Any]) -> None:
    write_file(path, json.dumps(content, indent=4) + "\n")
