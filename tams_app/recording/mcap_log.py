"""The MCAP file of a session: which record becomes which message.

Our records go out as JSON with a schema, video and poses as Foxglove's own messages. Chunks are
built in memory and written whole, so that a kill leaves no half-written chunk header behind.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from foxglove import Context, Schema, open_mcap
from foxglove.channels import CompressedVideoChannel, FrameTransformChannel
from foxglove.mcap import MCAPCompression, MCAPWriteOptions
from foxglove.messages import CompressedVideo, FrameTransform, Quaternion, Timestamp, Vector3

from tams_app.recording.disk import LogFile
from tams_app.recording.topics import (
    HEADER,
    PROFILE,
    TOPICS,
    TRANSFORMS,
    VIDEO_PREFIX,
    FrameSent,
    Header,
    OutcomeGiven,
)
from tams_app.records import EncodedFrame, Outcome, Pose, SceneTruth, Tick
from tams_app.units import NS_PER_S

CHUNK_BYTES = 256 * 1024


class McapLog:
    """The MCAP file itself, with a context of its own so that several logs never mix.

    Use it from one thread at a time: the SDK keeps the GIL while it waits for its own lock, and
    our file needs the GIL to finish a write, so two threads would wait for each other for ever.
    """

    def __init__(self, path: Path, header: Header, bitstream: bool = True) -> None:
        """`bitstream`: keep the encoded frames themselves, not only when they were sent."""
        self._bitstream = bitstream
        self._offset_ns = header.wall_offset_ns
        self._context = Context()
        self._file: LogFile | None = LogFile(path)
        self._mcap = open_mcap(
            self._file,
            context=self._context,
            writer_options=MCAPWriteOptions(
                compression=MCAPCompression.Zstd,
                compression_threads=0,
                profile=PROFILE,
                chunk_size=CHUNK_BYTES,
                disable_seeking=True,  # else a killed process leaves a chunk of unknown length
            ),
        )
        self._channels: dict[type, Any] = {}
        self._videos: dict[str, CompressedVideoChannel] = {}
        self._transforms = FrameTransformChannel(TRANSFORMS, context=self._context)
        self._last_tcp_ns = 0
        self._write_record(header, HEADER.time_ns(header))
        self.flush()

    def write(self, item: Any, now_ns: int) -> None:
        """Write one record; `now_ns` stands in where a record has no time of its own."""
        if isinstance(item, EncodedFrame):
            self._write_video(item)
            return
        if isinstance(item, Outcome):
            item = OutcomeGiven(now_ns, item)
        topic = TOPICS[type(item)]
        self._write_record(item, topic.time_ns(item))
        if isinstance(item, Tick):
            self._write_tcp(item)
        elif isinstance(item, SceneTruth):
            self._write_transform("block", item.block, item.t_ns)
            self._write_transform("container", item.container, item.t_ns)

    def flush(self) -> None:
        """Finish the chunk and hand it to the system; LogError if the disk refused."""
        self._mcap.flush()
        if self._file is not None:
            self._file.check()

    def close(self) -> None:
        """Finish the file, or cut it after its last whole chunk; may be called twice."""
        if self._file is None:
            return
        file, self._file = self._file, None
        self._mcap.close()
        file.close()  # of an error the owner has learned from `flush`

    def _write_record(self, item: Any, t_ns: int) -> None:
        channel = self._channels.get(type(item)) or self._open_channel(type(item))
        channel.log(TOPICS[type(item)].codec.encode(item), t_ns + self._offset_ns)

    def _open_channel(self, record_type: type) -> Any:
        topic = TOPICS[record_type]
        schema = Schema(name=record_type.__name__, encoding="jsonschema", data=topic.codec.schema())
        # not foxglove.Channel: that one keeps every channel of the process in a global table
        channel = self._context._create_channel(topic.name, message_encoding="json", schema=schema)
        self._channels[record_type] = channel
        return channel

    def _write_video(self, frame: EncodedFrame) -> None:
        sent = FrameSent(
            frame.view,
            frame.index,
            frame.capture_ns,
            frame.encoded_ns,
            frame.keyframe,
            len(frame.data),
            frame.pushed_ns,
            frame.rtp_timestamp,
        )
        self._write_record(sent, frame.encoded_ns)
        if not self._bitstream:
            return
        channel = self._videos.get(frame.view)
        if channel is None:
            channel = CompressedVideoChannel(VIDEO_PREFIX + frame.view, context=self._context)
            self._videos[frame.view] = channel
        message = CompressedVideo(
            timestamp=self._timestamp(frame.capture_ns),
            frame_id=frame.view,
            data=frame.data,
            format="h264",
        )
        channel.log(message, log_time=frame.encoded_ns + self._offset_ns)

    def _write_tcp(self, tick: Tick) -> None:
        if tick.arm is not None and tick.arm.received_ns != self._last_tcp_ns:
            self._last_tcp_ns = tick.arm.received_ns
            self._write_transform("tcp", tick.arm.tcp, tick.arm.received_ns)

    def _write_transform(self, name: str, pose: Pose, t_ns: int) -> None:
        x, y, z = pose.position.tolist()
        qx, qy, qz, qw = pose.rotation
        message = FrameTransform(
            timestamp=self._timestamp(t_ns),
            parent_frame_id="base",
            child_frame_id=name,
            translation=Vector3(x=x, y=y, z=z),
            rotation=Quaternion(x=qx, y=qy, z=qz, w=qw),
        )
        self._transforms.log(message, log_time=t_ns + self._offset_ns)

    def _timestamp(self, t_ns: int) -> Timestamp:
        seconds, nanoseconds = divmod(t_ns + self._offset_ns, NS_PER_S)
        return Timestamp(sec=seconds, nsec=nanoseconds)
