"""The layout of a LeRobotDataset v3.0: files, names and types.

Source: the documentation of LeRobot ("LeRobotDataset v3.0") and of its subtasks.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pyarrow as pa

from tams_app.export.lerobot.episode import Shape
from tams_app.export.lerobot.samples import ACTION_NAMES, STATE_NAMES

VERSION = "v3.0"
_FILE = "chunk-{chunk_index:03d}/file-{file_index:03d}"
DATA_PATH = f"data/{_FILE}.parquet"
VIDEO_PATH = "videos/{video_key}/" + f"{_FILE}.mp4"
EPISODES_PATH = f"meta/episodes/{_FILE}.parquet"
INFO_PATH, STATISTICS_PATH = "meta/info.json", "meta/stats.json"
TASKS_PATH, SUBTASKS_PATH = "meta/tasks.parquet", "meta/subtasks.parquet"
MB = 1 << 20  # as LeRobot counts them
FILES_PER_CHUNK, DATA_FILE_MB, VIDEO_FILE_MB = 1000, 100, 200

_STATE, _ACTION = "observation.state", "action"


def video_key(view: str) -> str:
    """The feature that a view becomes."""
    return f"observation.images.{view}"


def features(shape: Shape) -> dict[str, dict[str, Any]]:
    """Every feature with its type, shape and the names of its parts."""
    videos = {video_key(view): _video(shape) for view in shape.views}
    return {
        _STATE: _vector(STATE_NAMES),
        _ACTION: _vector(ACTION_NAMES),
        **videos,
        "phase": _scalar("string"),
        "subtask_index": _scalar("int64"),
        "engaged": _scalar("bool"),
        "timestamp": _scalar("float32"),
        "frame_index": _scalar("int64"),
        "episode_index": _scalar("int64"),
        "index": _scalar("int64"),
        "task_index": _scalar("int64"),
    }


def data_schema(shape: Shape) -> pa.Schema:
    """Of the files that hold all features but the videos, a row a frame."""
    return pa.schema(
        [
            (name, _arrow_type(feature))
            for name, feature in features(shape).items()
            if feature["dtype"] != "video"
        ]
    )


class FileNumber:
    """Counts the files of one kind as the layout does."""

    def __init__(self) -> None:
        self.chunk_index = 0
        self.file_index = 0

    def next(self) -> None:
        self.file_index += 1
        if self.file_index == FILES_PER_CHUNK:
            self.chunk_index, self.file_index = self.chunk_index + 1, 0

    def as_columns(self) -> dict[str, int]:
        """As episodes describe it."""
        return {"chunk_index": self.chunk_index, "file_index": self.file_index}

    def path(self, root: Path, template: str, **names: str) -> Path:
        """The file in its folder, which is made."""
        path = root / template.format(
            chunk_index=self.chunk_index, file_index=self.file_index, **names
        )
        path.parent.mkdir(parents=True, exist_ok=True)
        return path


def _scalar(dtype: str) -> dict[str, Any]:
    return {"dtype": dtype, "shape": [1], "names": None}


def _vector(names: tuple[str, ...]) -> dict[str, Any]:
    return {"dtype": "float32", "shape": [len(names)], "names": list(names)}


def _video(shape: Shape) -> dict[str, Any]:
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


def _arrow_type(feature: dict[str, Any]) -> pa.DataType:
    single = {
        "float32": pa.float32(),
        "int64": pa.int64(),
        "bool": pa.bool_(),
        "string": pa.string(),
    }[feature["dtype"]]
    (size,) = feature["shape"]
    return single if size == 1 else pa.list_(single, size)
