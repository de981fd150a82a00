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
from foxglove.messages import RawImage, Timestamp
from mcap.writer import Writer

from tams_app.recording import wire
from tams_app.recording.disk import RESERVE_FRACTION, LogFile, require_free_space, require_reserve
from tams_app.recording.mcap_stream import McapStream
from tams_app.recording.topics import REFERENCE_PREFIX, REFERENCE_PROFILE
from tams_app.recording.writer import QueuedWriter
from tams_app.records import Frame, Image
from tams_app.units import NS_PER_S

CAPACITY_FRAMES = 45  # half a second of three views, 40 MB
_WIDTH, _HEIGHT, _DATA = 2, 3, 6  # field numbers of foxglove.RawImage


class ReferenceRecorder(QueuedWriter[Frame]):
    """Writes captured frames without loss; `record` never blocks, drops are counted."""

    def __init__(
        self,
        path: Path,
        wall_offset_ns: int,
        min_free_mb: float,
        on_failure: Callable[[str, BaseException], None],
    ) -> None:
        """Create the file; LogError if there is no space or no folder."""
        super().__init__("reference-recorder", CAPACITY_FRAMES, on_failure)
        require_free_space(path.parent, min_free_mb)
        self._directory = path.parent
        self._reserve_mb = min_free_mb * RESERVE_FRACTION
        self._offset_ns = wall_offset_ns
        self._file = LogFile(path)
        self._writer = Writer(cast(IO[bytes], self._file), chunk_size=1)
        self._writer.start(profile=REFERENCE_PROFILE, library="tams")
        schema = RawImage.get_schema()
        self._schema_id = self._writer.register_schema(schema.name, schema.encoding, schema.data)
        self._channels: dict[str, int] = {}
        self._finished = False

    def record(self, frame: Frame) -> None:
        """Queue one frame; its image must not be changed afterwards."""
        if self.failure is None:
            self._queue.put(frame)

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
        require_reserve(self._directory, self._reserve_mb)
        height, width = frame.image.shape[:2]
        seconds, nanoseconds = divmod(frame.capture_ns + self._offset_ns, NS_PER_S)
        message = RawImage(
            timestamp=Timestamp(sec=seconds, nsec=nanoseconds),
            frame_id=frame.view,
            width=width,
            height=height,
            encoding="bgr8",
            step=width * 3,
            data=frame.image.tobytes(),
        )
        wall_ns = frame.capture_ns + self._offset_ns
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
        stored = wire.fields(message.data)
        height, width, data = stored[_HEIGHT], stored[_WIDTH], stored[_DATA]
        assert isinstance(height, int)
        assert isinstance(width, int)
        assert isinstance(data, bytes)
        image: Image = np.frombuffer(data, dtype=np.uint8).reshape(height, width, 3)
        view = topic.removeprefix(REFERENCE_PREFIX)
        yield Frame(view, message.sequence, message.log_time - wall_offset_ns, image)
