"""Reading a session log back, records and pictures as shown; also one that a crash cut off."""

from __future__ import annotations

from collections.abc import Container, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from operator import attrgetter
from pathlib import Path
from typing import Any

from mcap.records import Message

from tams_app import __version__
from tams_app.errors import UnreadableLogError
from tams_app.recording.mcap_stream import McapStream, messages_between, protobuf_fields
from tams_app.recording.topics import (
    HEADER,
    PICTURE_PREFIX,
    PROFILE,
    SCHEMA,
    TOPICS,
    VIDEO_PREFIX,
    FrameSent,
    Gap,
    Header,
    RecordsLost,
    SessionLog,
)
from tams_app.records import EncodedFrame, Phase, Tick
from tams_app.units import NS_PER_S

_VIDEO_DATA_FIELD = 3  # foxglove.CompressedVideo.data
_PICTURE_DATA_FIELD, _FORMAT_FIELD = 2, 3  # of foxglove.CompressedImage
_PICTURE_AT_MOST_NS = 2 * NS_PER_S
_TOPICS_BY_NAME = {topic.name: topic for topic in TOPICS.values()}


def read_log(path: Path, only: Container[type] | None = None) -> SessionLog:
    """Everything but the video of the log at `path`; UnreadableLogError if it is none of ours.

    `only`: the records that are wanted beside the header; None: all.
    """
    header, stream, messages = _opened(path)
    log = SessionLog(header, header.started_ns)
    for name, message in messages:
        if (topic := _TOPICS_BY_NAME.get(name)) is None:
            continue  # video, viewers' channels, and what a newer version may add
        if only is None or topic.record_type in only or topic.record_type is RecordsLost:
            with _as_we_write_it(path, topic.name):
                log.add(topic.decode(message.data))
        log.ended_ns = max(log.ended_ns, message.log_time - header.wall_offset_ns)
    log.truncated = not stream.complete and not stream.gaps
    log.gaps = [_session_time(gap, header.wall_offset_ns) for gap in stream.gaps]
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
    header, _, messages = _opened(path)
    yield header.started_ns, header
    sent: dict[str, FrameSent] = {}  # by the topic that their bytes follow on
    for name, message in messages:
        if (topic := _TOPICS_BY_NAME.get(name)) is not None:
            if only is not None and topic.record_type not in only:
                continue
            with _as_we_write_it(path, topic.name):
                record = topic.decode(message.data)
        elif (frame := sent.pop(name, None)) is not None:
            with _as_we_write_it(path, name):
                record = frame.with_data(_video_bytes(message.data))
        else:
            continue
        if isinstance(record, FrameSent):
            sent[VIDEO_PREFIX + record.view] = record
        yield message.log_time - header.wall_offset_ns, record


def read_video(path: Path, view: str) -> Iterator[EncodedFrame]:
    """The bitstream of one view as it was sent, frame by frame; errors as of `read_log`."""
    for _, record in read_records(path, only=(FrameSent,)):
        if isinstance(record, EncodedFrame) and record.view == view:
            yield record


def read_ticks(path: Path) -> Iterator[Tick]:
    """The control loop's ticks alone, in order; errors as of `read_log`."""
    return (record for _, record in read_records(path, only=(Tick,)) if isinstance(record, Tick))


def _opened(path: Path) -> tuple[Header, McapStream, Iterator[tuple[str, Message]]]:
    """The header of a log, and the messages after it; UnreadableLogError if it has none."""
    stream = McapStream(path, PROFILE)
    messages = iter(stream)
    for name, message in messages:
        if name == HEADER.name:
            with _as_we_write_it(path, name):
                header = HEADER.decode(message.data)
                if header.schema != SCHEMA:
                    other = "a newer" if header.schema > SCHEMA else "an older"
                    raise UnreadableLogError(
                        f"{path}: was written by {other} TAMS ({header.version}, logs of schema "
                        f"{header.schema}); read it with that"
                    )
                _check(header)
            return header, stream, messages
        if name in _TOPICS_BY_NAME:
            break
    if stream.gaps:
        raise UnreadableLogError(f"{path}: is damaged at its beginning; give an undamaged copy")
    raise UnreadableLogError(f"{path}: holds no session header; the session ended before it began")


def _session_time(gap: Gap, wall_offset_ns: int) -> Gap:
    start_ns, end_ns = (
        None if wall_ns is None else wall_ns - wall_offset_ns
        for wall_ns in (gap.start_ns, gap.end_ns)
    )
    return Gap(start_ns, end_ns)


def _video_bytes(message: bytes) -> bytes:
    payload = protobuf_fields(message).get(_VIDEO_DATA_FIELD, b"")
    if not isinstance(payload, bytes):
        raise TypeError("a frame's data are bytes")
    return payload


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


@dataclass(frozen=True, slots=True)
class ShownPicture:
    """A frame as it was shown: a JPEG file; `shown_ns` in nanoseconds since 1970."""

    view: str
    shown_ns: int
    data: bytes


def read_pictures(path: Path) -> Iterator[ShownPicture]:
    """All pictures of the log at `path`, in the order written; UnreadableLogError if it is none."""
    for topic, message in McapStream(path, PROFILE):
        if not topic.startswith(PICTURE_PREFIX):
            continue
        yield _picture(path, topic, message)


class PictureFinder:
    """The pictures of a log by time, read where they are asked for, all at once if it was cut."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._second: int | None = None
        self._pictures: list[ShownPicture] = []
        self._all: list[ShownPicture] = []  # of a log without an index

    def at(self, wall_ns: int) -> dict[str, ShownPicture]:
        """The picture of each view that was shown last, at most two seconds before `wall_ns`.

        UnreadableLogError if the log cannot be read there.
        """
        second = wall_ns // NS_PER_S
        if second != self._second:
            self._pictures, self._second = self._read(second), second
        found: dict[str, ShownPicture] = {}
        for picture in self._pictures:
            if wall_ns - _PICTURE_AT_MOST_NS <= picture.shown_ns <= wall_ns:
                found[picture.view] = picture
        return found

    def _read(self, second: int) -> list[ShownPicture]:
        """Those of a second and of the two before it, by time, as far as the log is whole."""
        start_ns, end_ns = second * NS_PER_S - _PICTURE_AT_MOST_NS, (second + 1) * NS_PER_S
        messages = messages_between(self._path, start_ns, end_ns)
        if messages is None:
            self._all = self._all or list(read_pictures(self._path))
            found = [one for one in self._all if start_ns <= one.shown_ns < end_ns]
        else:
            found = [
                _picture(self._path, topic, message)
                for topic, message in messages
                if topic.startswith(PICTURE_PREFIX)
            ]
        return sorted(found, key=attrgetter("shown_ns"))


def _picture(path: Path, topic: str, message: Message) -> ShownPicture:
    try:
        fields = protobuf_fields(message.data)
    except ValueError as error:
        raise UnreadableLogError(f"{path}: {topic!r} holds no picture: {error}") from error
    data = fields.get(_PICTURE_DATA_FIELD)
    if fields.get(_FORMAT_FIELD) != b"jpeg" or not isinstance(data, bytes):
        raise UnreadableLogError(f"{path}: {topic!r} holds what is no JPEG picture")
    return ShownPicture(topic.removeprefix(PICTURE_PREFIX), message.log_time, data)
