"""The MCAP file of a session: which record becomes which message.

Our records go out as JSON with a schema, video as Foxglove's own messages. Chunks are built in
memory and written whole, so that a kill leaves no half-written chunk behind. The file below never
raises into the encoder, keeps its error, and checks free space.
"""

from __future__ import annotations

import logging
import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from foxglove import Context, Schema, open_mcap, set_log_level
from foxglove.channels import CompressedVideoChannel
from foxglove.mcap import MCAPWriteOptions
from foxglove.messages import CompressedVideo, Timestamp

from tams_app.errors import LogError
from tams_app.recording.rates import RatesMeter
from tams_app.recording.topics import (
    HEADER,
    PROFILE,
    TOPICS,
    VIDEO_PREFIX,
    FrameSent,
    Header,
    OutcomeGiven,
    Topic,
)
from tams_app.records import EncodedFrame, Outcome, ShownFrame
from tams_app.units import NS_PER_S

BYTES_PER_MB = 1_000_000
RESERVE_FRACTION = 0.1  # of the free space asked for at the start: below it recording ends


def free_mb(directory: Path) -> float:
    """Free space [MB] for an ordinary user on the disk of `directory`."""
    return shutil.disk_usage(directory).free / BYTES_PER_MB


def require_free_space(directory: Path, min_free_mb: float) -> None:
    """LogError if the disk of `directory` has less than `min_free_mb` [MB] free."""
    try:
        free = free_mb(directory)
    except OSError as error:
        raise LogError(
            f"{directory}: the log folder cannot be used: {error.strerror}; choose another"
        ) from error
    if free < min_free_mb:
        raise LogError(
            f"{directory}: only {free:.0f} MB are free, {min_free_mb:.0f} MB are wanted; "
            "delete old logs or lower recording.min_free_mb"
        )


class LogFile:
    """A new file in the shape the MCAP writers want: `write`, `seek`, `flush`, `tell`.

    An error of the disk is kept and what follows goes nowhere, so that the writer on top can be
    closed in good order; the owner asks `check`.
    Unbuffered on purpose: what was written survives a kill of this process, and os.write releases
    the GIL, so a slow disk never holds up the control loop.
    """

    def __init__(self, path: Path, min_free_mb: float = 0.0) -> None:
        """LogError if there is no folder, or less than `min_free_mb` [MB] free on its disk."""
        require_free_space(path.parent, min_free_mb)
        self.path = path
        self._reserve_mb = min_free_mb * RESERVE_FRACTION
        self._error: OSError | None = None
        self._size_bytes = 0
        try:
            self._file = path.open("xb", buffering=0)
        except OSError as error:
            raise LogError(
                f"{path}: the log cannot be created: {error.strerror}; choose another folder"
            ) from error

    @property
    def size_bytes(self) -> int:
        """What was written whole; the disk is not asked."""
        return self._size_bytes

    def write(self, data: bytes | bytearray) -> int:
        """Write all of `data`."""
        view = memoryview(data)
        while view and self._error is None:
            try:
                view = view[self._file.write(view) :]
            except OSError as error:
                self._error = error
        if self._error is None:
            self._size_bytes += len(data)
        return len(data)

    def seek(self, offset: int, whence: int = os.SEEK_SET) -> int:
        return self._file.seek(offset, whence)

    def tell(self) -> int:
        return self._file.tell()

    def flush(self) -> None:
        """Nothing is buffered."""

    def check(self) -> None:
        """LogError if anything could not be written."""
        if self._error is not None:
            raise LogError(
                f"{self.path}: the log cannot be written any more: {self._error.strerror}; "
                "what was written before is readable"
            )

    def check_space(self) -> None:
        """LogError if the disk was filled but for the reserve."""
        free = free_mb(self.path.parent)
        if free < self._reserve_mb:
            raise LogError(
                f"{self.path.parent}: recording ended because only {free:.0f} MB are free; "
                "delete old logs; what was written before is readable"
            )

    def close(self) -> None:
        """Close it; after an error what did not fit is cut off.

        Both writers hand over whole records, so whole ones stay.
        """
        if self._error is not None:
            self._file.truncate(self._size_bytes)
        self._file.close()


def _keep_sdk_quiet() -> None:
    """Else its threads wait for the GIL to notify the operator's terminal of viewers that leave."""
    root, nothing = logging.getLogger(), logging.NullHandler()
    root.addHandler(nothing)  # without one the SDK would add one of its own, for everything
    set_log_level("CRITICAL")  # at which it reports nothing
    root.removeHandler(nothing)


_keep_sdk_quiet()  # only before the first file or server of the process


def timestamp(wall_ns: int) -> Timestamp:
    """Nanoseconds since 1970, in a message of Foxglove's."""
    seconds, nanoseconds = divmod(wall_ns, NS_PER_S)
    return Timestamp(sec=seconds, nsec=nanoseconds)


def json_channel(context: Context, topic: Topic[Any]) -> Any:
    """A channel for records of ours, with their schema."""
    name = topic.record_type.__name__
    schema = Schema(name=name, encoding="jsonschema", data=topic.schema())
    # not foxglove.Channel: that one keeps every channel of the process in a global table
    return context._create_channel(topic.name, message_encoding="json", schema=schema)


class Viewer:
    """A consumer of everything that a log keeps, for other programs; in the log's thread."""

    def receive(self, record: Any) -> None:
        """A record of the log, an encoded frame, a second's `Rates`, or a frame that it wanted."""

    def wants(self, view: str, shown_ns: int) -> bool:
        """Whether a frame shown now is wanted with its pixels; each view in one thread."""
        return False

    def close(self) -> None:
        """The log ends; may be called twice."""


class McapLog:
    """The log, with a context of its own so that several never mix.

    Use it from one thread at a time: the SDK keeps the GIL while it waits for its own lock, and
    our file needs the GIL to finish a write, so two threads would wait for each other for ever.
    """

    def __init__(
        self,
        path: Path,
        header: Header,
        bitstream: bool = True,
        viewers: Sequence[Viewer] = (),
        context: Context | None = None,
        min_free_mb: float = 0.0,
    ) -> None:
        """Create the file and write the header; LogError if there is no space or no folder.

        `bitstream`: keep the encoded frames themselves, not only when they were sent. `context`:
        one in which viewers have made channels, which go into the file, too. `viewers` are closed
        with the log, also where it cannot be made.
        """
        self._bitstream = bitstream
        self._offset_ns = header.wall_offset_ns
        self._context = Context() if context is None else context
        self._closed = False
        self._viewers = tuple(viewers)
        self.viewers_failure = ""  # why nothing is derived for viewers any more
        try:
            self._file = LogFile(path, min_free_mb)
        except LogError:
            self._close_viewers()
            raise
        self._mcap = open_mcap(
            self._file,
            context=self._context,
            writer_options=MCAPWriteOptions(
                compression_threads=0,
                profile=PROFILE,
                disable_seeking=True,  # else a killed process leaves a chunk of unknown length
            ),
        )
        self._channels: dict[str, Any] = {}
        self._videos: dict[str, CompressedVideoChannel] = {}
        self._meter = RatesMeter(header.views, header.started_ns)
        self.newest_ns = 0  # the latest time of any record
        try:
            self._write_record(header, HEADER.time_ns(header))
            self.flush()
        except BaseException:
            self.close()
            raise

    def write(self, item: Any, now_ns: int) -> None:
        """Write one record; `now_ns` stands in where a record has no time of its own."""
        if isinstance(item, EncodedFrame):
            self._write_video(item)
        elif isinstance(item, Outcome):
            item = OutcomeGiven(now_ns, item)
        if not isinstance(item, EncodedFrame | ShownFrame):  # the latter is for viewers alone
            self._write_record(item, TOPICS[type(item)].time_ns(item))
        if self._viewers and not self.viewers_failure:
            with self._spared():
                self._send(item)
                if (rates := self._meter.step(item, now_ns)) is not None:
                    self._send(rates)

    @property
    def size_bytes(self) -> int:
        """What was handed to the system so far; the disk is not asked."""
        return self._file.size_bytes

    def wants_pixels(self, shown: ShownFrame) -> bool:
        """Whether a frame shown is to be written with its pixels, too; each view in one thread."""
        if self.viewers_failure:
            return False
        # each is asked, as each keeps its own pace
        wanted = [viewer.wants(shown.view, shown.shown_ns) for viewer in self._viewers]
        return any(wanted)

    def flush(self) -> None:
        """Finish the chunk and hand it to the system; LogError if the disk refused."""
        self._mcap.flush()
        self._file.check()

    def check_space(self) -> None:
        """LogError if the disk was filled but for a reserve."""
        self._file.check_space()

    def close(self) -> None:
        """Finish the file, or cut it after its last whole chunk; may be called twice."""
        if self._closed:
            return
        self._closed = True
        self._close_viewers()
        self._mcap.close()
        self._file.close()  # of an error the owner has learned from `flush`

    @contextmanager
    def _spared(self) -> Iterator[None]:
        """A viewer's failure is never the log's; the owner asks for it."""
        try:
            yield
        except Exception as error:  # noqa: BLE001 - viewers may be anything
            self.viewers_failure = f"viewers are sent nothing more ({error!r}); the log goes on"

    def _close_viewers(self) -> None:
        with self._spared():
            for viewer in self._viewers:
                viewer.close()

    def _send(self, record: Any) -> None:
        for viewer in self._viewers:
            viewer.receive(record)

    def _write_record(self, item: Any, t_ns: int) -> None:
        self.newest_ns = max(self.newest_ns, t_ns)
        topic = TOPICS[type(item)]
        channel = self._channels.get(topic.name)
        if channel is None:
            channel = json_channel(self._context, topic)
            self._channels[topic.name] = channel
        channel.log(topic.encode(item), t_ns + self._offset_ns)

    def _write_video(self, frame: EncodedFrame) -> None:
        self._write_record(FrameSent.of(frame), frame.encoded_ns)
        if not self._bitstream:
            return
        channel = self._videos.get(frame.view)
        if channel is None:
            channel = CompressedVideoChannel(VIDEO_PREFIX + frame.view, context=self._context)
            self._videos[frame.view] = channel
        message = CompressedVideo(
            timestamp=timestamp(frame.capture_ns + self._offset_ns),
            frame_id=frame.view,
            data=frame.data,
            format="h264",
        )
        channel.log(message, log_time=frame.encoded_ns + self._offset_ns)
