"""The pictures of a log as the operator saw them, read back."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mcap.records import Message

from tams_app.errors import UnreadableLogError
from tams_app.recording import wire
from tams_app.recording.mcap_stream import McapStream, messages_between
from tams_app.recording.topics import PICTURE_PREFIX, PROFILE
from tams_app.units import NS_PER_S

_AT_MOST_NS = 2 * NS_PER_S
_JPEG = b"jpeg"
_DATA_FIELD, _FORMAT_FIELD = 2, 3  # of foxglove.CompressedImage


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
            if wall_ns - _AT_MOST_NS <= picture.shown_ns <= wall_ns:
                found[picture.view] = picture
        return found

    def _read(self, second: int) -> list[ShownPicture]:
        """Those of a second and of the two before it, by time, as far as the log is whole."""
        start_ns, end_ns = second * NS_PER_S - _AT_MOST_NS, (second + 1) * NS_PER_S
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
        return sorted(found, key=lambda one: one.shown_ns)


def _picture(path: Path, topic: str, message: Message) -> ShownPicture:
    try:
        fields = wire.fields(message.data)
    except ValueError as error:
        raise UnreadableLogError(f"{path}: {topic!r} holds no picture: {error}") from error
    data = fields.get(_DATA_FIELD)
    if fields.get(_FORMAT_FIELD) != _JPEG or not isinstance(data, bytes):
        raise UnreadableLogError(f"{path}: {topic!r} holds what is no JPEG picture")
    return ShownPicture(topic.removeprefix(PICTURE_PREFIX), message.log_time, data)
