"""Writes the files of a LeRobotDataset v3.0; `meta/info.json` comes last.

Their names and types are those of LeRobot's documentation ("LeRobotDataset v3.0", and subtasks).
"""

from __future__ import annotations

import json
from collections.abc import Generator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray

from tams_app.export.lerobot.episode import ACTION_NAMES, PHASES, STATE_NAMES, EpisodeSource, Shape
from tams_app.export.lerobot.statistics import PixelStatistics, Statistics, statistics_of
from tams_app.export.lerobot.video import write_video
from tams_app.outputs import write_file

MB = 1 << 20  # as LeRobot counts them
FILES_PER_CHUNK, DATA_FILE_MB, VIDEO_FILE_MB = 1000, 100, 200
_FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}"
_DATA_PATH = f"data/{_FILE}.parquet"
_VIDEO_PATH = "videos/{video_key}/" + f"{_FILE}.mp4"
_NUMBERS = ("chunk_index", "file_index")
_NAMES = {"observation.state": list(STATE_NAMES), "action": list(ACTION_NAMES)}


def write_dataset(root: Path, episodes: Sequence[EpisodeSource], task: str) -> Generator[None]:
    """Write a dataset in the folder `root`, of episodes that have one shape, by one `task`.

    Each has video files of its own, as the rate of each is held to that of its log. Yields after
    each frame of each view. Errors of the file system are OSError or LogError.
    """
    shape = episodes[0].shape
    parts: list[dict[str, NDArray[Any]]] = []
    pixels = {f"observation.images.{view}": PixelStatistics() for view in shape.views}
    described: list[dict[str, Any]] = []
    rows = 0
    for number, episode in enumerate(episodes):
        parts.append(_columns(episode, number, rows))
        described.append(_described(episode, number, rows) | {"tasks": [task]})
        statistics = _statistics(parts[-1])
        numbers = dict(zip(_NUMBERS, divmod(number, FILES_PER_CHUNK), strict=True))
        for view, (key, total) in zip(shape.views, pixels.items(), strict=True):
            path = root / _VIDEO_PATH.format(video_key=key, **numbers)
            seen = yield from write_video(path, episode, view)
            total.include(seen)
            statistics[key] = seen.result()
            times = {"from_timestamp": 0.0, "to_timestamp": episode.rows / shape.fps}
            described[-1] |= {f"videos/{key}/{name}": of for name, of in (numbers | times).items()}
        described[-1] |= {
            f"stats/{feature}/{name}": value
            for feature, found in statistics.items()
            for name, value in found.items()
        }
        rows += episode.rows
    columns = {name: np.concatenate([one[name] for one in parts]) for name in parts[0]}
    data = pa.table({name: _arrow(column) for name, column in columns.items()})
    _write_table(root / _DATA_PATH.format(chunk_index=0, file_index=0), data)
    table = pa.Table.from_pylist(described)
    _write_table(root / "meta/episodes/chunk-000/file-000.parquet", table)
    _write_names(root / "meta/tasks.parquet", "task", [task])
    _write_names(root / "meta/subtasks.parquet", "subtask", list(PHASES))
    whole = _statistics(columns) | {key: total.result() for key, total in pixels.items()}
    info = {
        "codebase_version": "v3.0",
        "robot_type": shape.arm,
        "total_episodes": len(episodes),
        "total_frames": rows,
        "total_tasks": 1,
        "chunks_size": FILES_PER_CHUNK,
        "data_files_size_in_mb": _file_mb(root, "parquet", DATA_FILE_MB),
        "video_files_size_in_mb": _file_mb(root, "mp4", VIDEO_FILE_MB),
        "fps": shape.fps,
        "splits": {"train": f"0:{len(episodes)}"},
        "data_path": _DATA_PATH,
        "video_path": _VIDEO_PATH,
        "features": {name: _feature(name, column) for name, column in columns.items()}
        | {key: _video_feature(shape) for key in pixels},
    }
    for name, content in {"stats": whole, "info": info}.items():
        write_file(root / f"meta/{name}.json", json.dumps(content, indent=4) + "\n")


def _columns(episode: EpisodeSource, number: int, rows_before: int) -> dict[str, NDArray[Any]]:
    count = np.arange(episode.rows)
    return episode.columns | {
        "timestamp": (count / episode.shape.fps).astype(np.float32),
        "frame_index": count,
        "episode_index": np.full(episode.rows, number),
        "index": rows_before + count,
        "task_index": np.zeros(episode.rows, np.int64),
    }


def _described(episode: EpisodeSource, number: int, rows_before: int) -> dict[str, Any]:
    """What holds for the whole episode; what may be null in every one has its type."""
    header, outcome = episode.header, episode.outcome
    return {
        "episode_index": number,
        "length": episode.rows,
        "dataset_from_index": rows_before,
        "dataset_to_index": rows_before + episode.rows,
        **{f"{kind}/{name}": 0 for kind in ("data", "meta/episodes") for name in _NUMBERS},
        "session": episode.name,
        "session_episode": pa.scalar(episode.number, pa.int64()),
        "log_complete": not episode.remark,
        "success": pa.scalar(outcome.success, pa.bool_()),
        "completed": pa.scalar(outcome.completed, pa.bool_()),
        "completion_time_s": pa.scalar(outcome.completion_time_s, pa.float64()),
        "drops": pa.scalar(outcome.drops, pa.int64()),
        "outcome": outcome.reason,
        "strategy": header.strategy,
        "network": header.network,
        "seed": header.seed,
        "started_wall_ns": int(episode.grid_ns[0]) + header.wall_offset_ns,
    }


def _statistics(columns: Mapping[str, NDArray[Any]]) -> dict[str, Statistics]:
    return {name: statistics_of(column) for name, column in columns.items() if name != "phase"}


def _arrow(column: NDArray[Any]) -> pa.Array:
    if column.ndim == 1:
        return pa.array(column)
    return pa.FixedSizeListArray.from_arrays(column.ravel(), column.shape[1])


def _feature(name: str, column: NDArray[Any]) -> dict[str, Any]:
    dtype = "string" if column.dtype.kind == "U" else str(column.dtype)
    return {"dtype": dtype, "shape": [*column.shape[1:]] or [1], "names": _NAMES.get(name)}


def _video_feature(shape: Shape) -> dict[str, Any]:
    return {
        "dtype": "video",
        "shape": [shape.height, shape.width, 3],
        "names": ["height", "width", "channels"],
        "info": {
            "video.height": shape.height,
            "video.width": shape.width,
            "video.codec": "h264",
            "video.pix_fmt": "yuv420p",
            "video.is_depth_map": False,
            "video.fps": shape.fps,
            "video.channels": 3,
            "has_audio": False,
        },
    }


def _file_mb(root: Path, kind: str, usual: int) -> int:
    """What no file of that kind is above; more than usual where one alone is."""
    largest = max(path.stat().st_size for path in root.rglob(f"*.{kind}"))
    return max(usual, -(-largest // MB))


def _write_names(path: Path, kind: str, names: list[str]) -> None:
    """A table from name to number, whose index is the names for who reads it with pandas."""
    index = {"name": kind, "field_name": kind, "pandas_type": "unicode", "numpy_type": "object"}
    about = {"index_columns": [kind], "column_indexes": [], "columns": [index | {"metadata": None}]}
    table = pa.table({f"{kind}_index": range(len(names)), kind: names})
    _write_table(path, table.replace_schema_metadata({"pandas": json.dumps(about)}))


def _write_table(path: Path, table: pa.Table) -> None:
    path.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table, path)
