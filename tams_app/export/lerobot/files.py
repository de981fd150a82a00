"""The files of rows and of frames: the next episode goes to a new one where the last is full."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path
from typing import Any

import pyarrow as pa
import pyarrow.parquet as pq

from tams_app.export.lerobot import layout
from tams_app.export.lerobot.episode import Episode, Shape
from tams_app.export.lerobot.frames import frames_on_grid
from tams_app.export.lerobot.layout import FileNumber, video_key
from tams_app.export.lerobot.mp4 import BUFFER_S, Mp4Writer
from tams_app.export.lerobot.statistics import PixelStatistics, Statistics

_FRAMES_LOOKED_AT = 100  # in each view of an episode, for the statistics of its pixels
_SHARE = 1.15  # of the log's own video: what a dataset's may be at most
_INDEX_BYTES = 32  # of an MP4 file for each frame, beside the frame, and more


class DataFiles:
    """The rows of all episodes."""

    def __init__(self, root: Path, shape: Shape) -> None:
        self._root = root
        self._schema = layout.data_schema(shape)
        self._number = FileNumber()
        self._path = root
        self._writer: pq.ParquetWriter | None = None

    def append(self, columns: Mapping[str, Any]) -> dict[str, int]:
        """Add an episode's rows, an array or list for each feature; which file they went to."""
        arrays = []
        for field in self._schema:
            column = columns[field.name]
            if pa.types.is_fixed_size_list(field.type):
                arrays.append(pa.FixedSizeListArray.from_arrays(column.ravel(), type=field.type))
            else:
                arrays.append(pa.array(column, field.type))
        table = pa.Table.from_arrays(arrays, schema=self._schema)
        self._with_space(table.nbytes).write_table(table)
        return self._number.as_columns()

    def close(self) -> None:
        """Finish the last file; may be called twice."""
        if self._writer is not None:
            self._writer.close()

    def _with_space(self, size_bytes: int) -> pq.ParquetWriter:
        if self._writer is not None:
            if self._path.stat().st_size + size_bytes < layout.DATA_FILE_MB * layout.MB:
                return self._writer
            self._writer.close()
            self._number.next()
        self._path = self._number.path(self._root, layout.DATA_PATH)
        self._writer = pq.ParquetWriter(self._path, self._schema)
        return self._writer


class VideoFiles:
    """One view of all episodes."""

    def __init__(self, root: Path, shape: Shape, view: str) -> None:
        self._root = root
        self._shape = shape
        self._view = view
        self._number = FileNumber()
        self._path = root
        self._writer: Mp4Writer | None = None

    def append(
        self, episode: Episode, on_frame: Callable[[], None]
    ) -> tuple[dict[str, float], Statistics]:
        """Add an episode's frames; where they went [s], and what their pixels are like."""
        fps, sizes = self._shape.fps, episode.sizes[self._view]
        seconds = episode.rows / fps
        at_most = _SHARE * float(sizes.sum())
        writer = self._with_space(at_most + _INDEX_BYTES * episode.rows)
        # what the encoder's buffer lets through beside the rate is part of the share
        kbit = at_most / seconds / (1 + BUFFER_S / seconds) * 8 / 1000
        pixels = PixelStatistics()
        step = -(-episode.rows // _FRAMES_LOOKED_AT)
        first = writer.frames
        writer.limit(kbit)
        writer.begin_episode()
        with closing(frames_on_grid(episode, self._view)) as frames:
            for row, planes in enumerate(frames):
                writer.write(planes)
                if row % step == 0:
                    pixels.add(planes, self._shape.height, self._shape.width)
                on_frame()
        placed = {
            **self._number.as_columns(),
            "from_timestamp": first / self._shape.fps,
            "to_timestamp": writer.frames / self._shape.fps,
        }
        return placed, pixels.result()

    def close(self) -> None:
        """Finish the last file."""
        if self._writer is not None:
            self._writer.close()

    def abandon(self) -> None:
        """Leave the last file as it is; may be called twice, and after `close`."""
        if self._writer is not None:
            self._writer.abandon()

    def _with_space(self, size_bytes: float) -> Mp4Writer:
        if self._writer is not None:
            written = self._path.stat().st_size + _INDEX_BYTES * self._writer.frames
            if written + size_bytes < layout.VIDEO_FILE_MB * layout.MB:
                return self._writer
            self._writer.close()
            self._number.next()
        key, shape = video_key(self._view), self._shape
        self._path = self._number.path(self._root, layout.VIDEO_PATH, video_key=key)
        self._writer = Mp4Writer(self._path, shape.width, shape.height, shape.fps)
        return self._writer
