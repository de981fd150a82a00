"""The pictures of a log as the operator saw them, read back."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from mcap.reader import SeekingReader
from mcap.records import Message

from tams_app.errors import UnreadableLogError
from tams_app.recording import wire
from tams_app.recording.mcap_stream import DAMAGE, McapStream
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
    """The pictures of a whole log by time, read where they are asked for."""

    def __init__(self, path: Path) -> None:
        self._path = path
        self._second: int | None = None
        self._pictures: list[ShownPicture] = []

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
        """Those of a second and of the two before it, by time."""
        start_ns, end_ns = second * NS_PER_S - _AT_MOST_NS, (second + 1) * NS_PER_S
        try:
            with self._path.open("rb") as file:
                reader = SeekingReader(file)
                summary = reader.get_summary()
                channels = () if summary is None else summary.channels.values()
                topics = [one.topic for one in channels if one.topic.startswith(PICTURE_PREFIX)]
                if not topics:
                    return []
                return [
                    _picture(self._path, channel.topic, message)
                    for _, channel, message in reader.iter_messages(
                        topics, starting_at=start_ns, ending_before=end_ns
                    )
                ]
        except (OSError, *DAMAGE) as error:
            raise UnreadableLogError(f"{self._path}: pictures cannot be read: {error}") from error


def _picture(path: Path, topic: str, message: Message) -> ShownPicture:
    try:
        fields = wire.fields(message.data)
    except ValueError as error:
        raise UnreadableLogError(f"{path}: {topic!r} holds no picture: {error}") from error
    data = fields.get(_DATA_FIELD)
    if fields.get(_FORMAT_FIELD) != _JPEG or not isinstance(data, bytes):
        raise UnreadableLogError(f"{path}: {topic!r} holds what is no JPEG picture")
    return ShownPicture(topic.removeprefix(PICTURE_PREFIX), message.log_time, data)
