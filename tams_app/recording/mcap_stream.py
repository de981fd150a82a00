"""The messages of one of our MCAP files in the order they were written, as far as it is whole."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from mcap.exceptions import McapError
from mcap.records import Channel, Footer, Header, Message
from mcap.stream_reader import StreamReader
from zstandard import ZstdError

from tams_app.errors import LogError

_RECORD_LIMIT_BYTES = 1 << 30
_DAMAGE = (McapError, struct.error, ZstdError, EOFError)  # what a cut-off file makes of the reader


class McapStream:
    """Iterates over (topic, message); LogError if the file is not of the wanted profile.

    `complete` tells afterwards whether the file had its proper end.
    """

    def __init__(self, path: Path, profile: str) -> None:
        self._path = path
        self._profile = profile
        self.complete = False

    def __iter__(self) -> Iterator[tuple[str, Message]]:
        try:
            stream = self._path.open("rb")
        except OSError as error:
            raise LogError(f"{self._path} cannot be read ({error.strerror}).") from error
        with stream:
            records = iter(StreamReader(stream, record_size_limit=_RECORD_LIMIT_BYTES).records)
            first = _next(records)
            if not isinstance(first, Header) or first.profile != self._profile:
                raise LogError(f"{self._path} is not a TAMS {self._kind} log; give one of those.")
            topics: dict[int, str] = {}
            while (record := _next(records)) is not None:
                if isinstance(record, Message):
                    yield topics[record.channel_id], record
                elif isinstance(record, Channel):
                    topics[record.id] = record.topic
                elif isinstance(record, Footer):
                    self.complete = True

    @property
    def _kind(self) -> str:
        return self._profile.removeprefix("tams-")


def _next(records: Iterator[Any]) -> Any:
    """The next record, or None at the end, be it proper or damaged."""
    try:
        return next(records, None)
    except _DAMAGE:
        return None  # no footer was seen: the stream stays incomplete
