"""Lossless captures beside the log, for judging the frames later: `reference.mcap`.

Foxglove raw images, one per chunk, compressed with zstd outside the GIL. Measured at 640×480: the
rig's frames 0.2 ms, noisy ones 4–6 ms and 0.5 MB a frame; PNG takes 5–18 ms, lossless WebP 90 ms.
"""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, cast

import numpy as np
from foxglove.messages import RawImage
from mcap.writer import Writer

from tams_app.recording.mcap_log import LogFile, timestamp
from tams_app.recording.mcap_stream import McapStream, protobuf_fields
from tams_app.recording.topics import REFERENCE_PREFIX, REFERENCE_PROFILE
from tams_app.records import Frame, Image
from tams_app.runtime.mailbox import BoundedQueue
from tams_app.runtime.worker import Worker

CAPACITY_FRAMES = 45  # half a second of three views, 40 MB
_WIDTH, _HEIGHT, _DATA = 2, 3, 6  # field numbers of foxglove.RawImage


class ReferenceRecorder:
    """Writes captured frames without loss; `record` never blocks, drops are counted."""

    def __init__(
        self,
        path: Path,
        wall_offset_ns: int,
        min_free_mb: float,
        on_failure: Callable[[str, BaseException], None],
    ) -> None:
        """Create the file; LogError if there is no space or no folder."""
        self._offset_ns = wall_offset_ns
        self._file = LogFile(path, min_free_mb)
        self._writer = Writer(cast(IO[bytes], self._file), chunk_size=1)
        self._writer.start(profile=REFERENCE_PROFILE, library="tams")
        schema = RawImage.get_schema()
        self._schema_id = self._writer.register_schema(schema.name, schema.encoding, schema.data)
        self._channels: dict[str, int] = {}
        self._finished = False
        self._queue: BoundedQueue[Frame] = BoundedQueue(CAPACITY_FRAMES)
        self._worker = Worker("reference-recorder", self._run, on_failure)

    def start(self) -> None:
        self._worker.start()

    @property
    def dropped(self) -> int:
        """Frames that found the queue full."""
        return self._queue.dropped

    def record(self, frame: Frame) -> None:
        """Queue one frame; its image must not be changed afterwards."""
        if self._worker.failure is None:
            self._queue.put(frame)

    def close(self, timeout_s: float = 10.0) -> None:
        """Write what is queued and finish the file; may be called twice."""
        if self._worker.alive:
            self._worker.stop(timeout_s)
        self._finish()  # done by the thread already, unless it never ran

    def _run(self, stop: threading.Event) -> None:
        try:
            while not stop.is_set():
                for frame in self._queue.take_all(timeout_s=0.2):
                    self._write(frame)
            for frame in self._queue.take_all():
                self._write(frame)
        finally:
            self._finish()

    def _write(self, frame: Frame) -> None:
        self._file.check_space()
        height, width = frame.image.shape[:2]
        wall_ns = frame.capture_ns + self._offset_ns
        message = RawImage(
            timestamp=timestamp(wall_ns),
            frame_id=frame.view,
            width=width,
            height=height,
            encoding="bgr8",
            step=width * 3,
            data=frame.image.tobytes(),
        )
        self._writer.add_message(
            self._channel(frame.view), wall_ns, message.encode(), wall_ns, sequence=frame.index
        )
        self._file.check()

    def _channel(self, view: str) -> int:
        if view not in self._channels:
            self._channels[view] = self._writer.register_channel(
                REFERENCE_PREFIX + view,
                "protobuf",
                self._schema_id,
            )
        return self._channels[view]

    def _finish(self) -> None:
        if self._finished:
            return
        self._finished = True
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()  # of an error the owner has learned from `_write`


def read_reference(path: Path, wall_offset_ns: int) -> Iterator[Frame]:
    """The captures as they were, in the order recorded; LogError if `path` is none of ours."""
    for topic, message in McapStream(path, REFERENCE_PROFILE):
        stored = protobuf_fields(message.data)
        height, width, data = stored[_HEIGHT], stored[_WIDTH], stored[_DATA]
        assert isinstance(height, int)
        assert isinstance(width, int)
        assert isinstance(data, bytes)
        image: Image = np.frombuffer(data, dtype=np.uint8).reshape(height, width, 3)
        view = topic.removeprefix(REFERENCE_PREFIX)
        yield Frame(view, message.sequence, message.log_time - wall_offset_ns, image)
