"""Reading a session log back, also one that a crash cut off."""

from __future__ import annotations

from collections.abc import Container, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from tams_app import __version__
from tams_app.errors import UnreadableLogError
from tams_app.recording import wire
from tams_app.recording.mcap_stream import Gap, McapStream
from tams_app.recording.topics import (
    FORMER_NAMES,
    PROFILE,
    SCHEMA,
    TOPICS,
    VIDEO_PREFIX,
    FrameSent,
    Header,
    RecordsLost,
    SessionLog,
)
from tams_app.records import EncodedFrame, Phase, Tick

_VIDEO_DATA_FIELD = 3  # foxglove.CompressedVideo.data
_RENAMED_SCHEMA = 4
_TOPICS_BY_NAME = {topic.name: topic for topic in TOPICS.values()}


def read_log(path: Path, only: Container[type] | None = None) -> SessionLog:
    """Everything but the video of the log at `path`; UnreadableLogError if it is none of ours.

    `only`: the records that are wanted beside the header; None: all.
    """
    log: SessionLog | None = None
    stream = McapStream(path, PROFILE)
    for name, message in stream:
        topic = _topic(name, None if log is None else log.header)
        if topic is None:
            continue
        record_type = topic.record_type
        if log is None or only is None or record_type in only or record_type is RecordsLost:
            record = _decode(path, topic, message.data)
            if isinstance(record, Header):
                log = SessionLog(record, record.started_ns)
            if log is None:
                break
            with _as_we_write_it(path, topic.name):
                log.add(record)
        log.ended_ns = max(log.ended_ns, message.log_time - log.header.wall_offset_ns)
    if log is None and stream.gaps:
        raise UnreadableLogError(f"{path}: is damaged at its beginning; give an undamaged copy")
    if log is None:
        raise UnreadableLogError(
            f"{path}: holds no session header; the session ended before it began"
        )
    log.truncated = not stream.complete and not stream.gaps
    log.gaps = [_session_time(gap, log.header.wall_offset_ns) for gap in stream.gaps]
    log.gaps += [Gap(one.since_ns, one.t_ns) for one in log.lost]
    return log


def damage_of(path: Path) -> str:
    """What the log at `path` lacks, as `damage_sentence` says it; errors as of `read_log`."""
    return read_log(path, only=()).damage


def read_records(path: Path, only: Container[type] | None = None) -> Iterator[tuple[int, Any]]:
    """Every record of the log at `path` with its time, as it was written; errors as of `read_log`.

    `only`: the records that are wanted beside the header, which is the first; None: all. After each
    `FrameSent` comes its `EncodedFrame`, if its bytes were kept. Of a log that is damaged or cut
    off, what can be read.
    """
    header: Header | None = None
    sent: dict[str, FrameSent] = {}  # by the topic that their bytes follow on
    for name, message in McapStream(path, PROFILE):
        if (topic := _topic(name, header)) is not None:
            if header is not None and only is not None and topic.record_type not in only:
                continue
            record = _decode(path, topic, message.data)
        elif (frame := sent.pop(name, None)) is not None:
            with _as_we_write_it(path, name):
                record = frame.with_data(_video_bytes(message.data))
        else:
            continue
        if isinstance(record, Header):
            header = record
        elif isinstance(record, FrameSent):
            sent[VIDEO_PREFIX + record.view] = record
        if header is None:
            break
        yield message.log_time - header.wall_offset_ns, record
    if header is None:
        raise UnreadableLogError(f"{path}: holds no session header at its beginning")


def read_video(path: Path, view: str) -> Iterator[EncodedFrame]:
    """The bitstream of one view as it was sent, frame by frame; errors as of `read_log`."""
    for _, record in read_records(path, only=(FrameSent,)):
        if isinstance(record, EncodedFrame) and record.view == view:
            yield record


def read_ticks(path: Path) -> Iterator[Tick]:
    """The control loop's ticks alone, in order; errors as of `read_log`."""
    return (record for _, record in read_records(path, only=(Tick,)) if isinstance(record, Tick))


def _topic(name: str, header: Header | None) -> Any:
    """What a log with that header has on a topic of that name.

    None: video, viewers' channels, and what a newer version may add.
    """
    if header is not None and header.schema < _RENAMED_SCHEMA:
        name = FORMER_NAMES.get(name, name)
    return _TOPICS_BY_NAME.get(name)


def _session_time(gap: Gap, wall_offset_ns: int) -> Gap:
    start_ns, end_ns = (
        None if wall_ns is None else wall_ns - wall_offset_ns
        for wall_ns in (gap.start_ns, gap.end_ns)
    )
    return Gap(start_ns, end_ns)


def _video_bytes(message: bytes) -> bytes:
    payload = wire.fields(message).get(_VIDEO_DATA_FIELD, b"")
    if not isinstance(payload, bytes):
        raise TypeError("a frame's data are bytes")
    return payload


def _decode(path: Path, topic: Any, data: bytes) -> Any:
    """One record."""
    with _as_we_write_it(path, topic.name):
        record = topic.decode(data)
        if isinstance(record, Header):
            if record.schema > SCHEMA:
                raise UnreadableLogError(
                    f"{path}: was written by the newer TAMS {record.version}; read it with that"
                )
            _check(record)
    return record


def _check(header: Header) -> None:
    """ValueError for what no configuration allows, and what reads the log divides by."""
    shares = [set(header.weights[phase]) for phase in Phase]
    if not header.views or any(not set(header.views) <= views for views in shares):
        raise ValueError("each view has a weight in each phase")
    if header.fps <= 0 or not header.control_rate_hz > 0:
        raise ValueError("rates are above zero")


@contextmanager
def _as_we_write_it(path: Path, topic: str) -> Iterator[None]:
    """The checksums have shown the data to be as written: what it fails by is another version's."""
    try:
        yield
    except (AttributeError, KeyError, TypeError, ValueError, RecursionError) as error:
        raise UnreadableLogError(
            f"{path}: {topic} is not as TAMS {__version__} writes it; "
            "read this log with the program and version that wrote it"
        ) from error
