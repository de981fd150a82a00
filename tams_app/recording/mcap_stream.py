"""The messages of one of our MCAP files in the order they were written, as far as it is whole."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path
from typing import IO, Any, cast

from mcap.exceptions import EndOfFile, McapError
from mcap.records import Channel, Footer, Header, Message
from mcap.stream_reader import StreamReader
from zstandard import ZstdError

from tams_app.errors import LogError

_RECORD_LIMIT_BYTES = 1 << 30
# What flipped bytes make of the reader; a checksum that does not fit is a ValueError.
_DAMAGE = (McapError, ZstdError, struct.error, ValueError, OverflowError, MemoryError)


class McapStream:
    """Iterates over (topic, message); LogError if the file is not of the wanted profile.

    Ends early where the file is cut off or damaged: `complete` tells afterwards whether it had its
    proper end, `damaged` whether anything in it is not as it was written.
    """

    def __init__(self, path: Path, profile: str) -> None:
        self._path = path
        self._profile = profile
        self.complete = False
        self.damaged = False

    def __iter__(self) -> Iterator[tuple[str, Message]]:
        try:
            stream = self._path.open("rb")
        except OSError as error:
            raise LogError(f"{self._path}: cannot be read: {error.strerror}") from error
        with stream:
            reader = StreamReader(
                cast(IO[bytes], _WholeReads(stream)),
                validate_crcs=True,
                record_size_limit=_RECORD_LIMIT_BYTES,
            )
            records = iter(reader.records)
            first = self._next(records)
            if not isinstance(first, Header) or first.profile != self._profile:
                raise LogError(f"{self._path}: is not a TAMS {self._kind} log; give one of those")
            topics: dict[int, str] = {}
            while (record := self._next(records)) is not None:
                if isinstance(record, Message):
                    if record.channel_id not in topics:
                        self.damaged = True  # the chunk that says so is lost
                        return
                    yield topics[record.channel_id], record
                elif isinstance(record, Channel):
                    topics[record.id] = record.topic
                elif isinstance(record, Footer):
                    self.complete = True

    @property
    def _kind(self) -> str:
        return self._profile.removeprefix("tams-")

    def _next(self, records: Iterator[Any]) -> Any:
        """The next record, or None at the end, be it proper, cut off or damaged."""
        try:
            return next(records, None)
        except EndOfFile:
            return None  # no footer was seen: the stream stays incomplete
        except _DAMAGE:
            self.damaged = True
            return None


class _WholeReads:
    """A file that ends where a record is cut off; the reader would take half of it for damage."""

    def __init__(self, stream: IO[bytes]) -> None:
        self._stream = stream

    def read(self, size: int) -> bytes:
        """Exactly `size` bytes; EndOfFile if there are fewer."""
        data = self._stream.read(size)
        if len(data) < size:
            raise EndOfFile
        return data
