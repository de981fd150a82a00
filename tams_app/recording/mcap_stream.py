"""The messages of one of our MCAP files in the order they were written, as far as it is whole."""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO
from operator import attrgetter
from pathlib import Path
from typing import IO, cast

from mcap.exceptions import EndOfFile, McapError
from mcap.reader import SeekingReader
from mcap.records import Channel, Chunk, ChunkIndex, Footer, Header, McapRecord, Message
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.summary import Summary
from zstandard import ZstdError, frame_content_size

from tams_app.errors import UnreadableLogError
from tams_app.recording.topics import Gap

_LIMIT_BYTES = 1 << 26  # of a record, and of a chunk unpacked: ours have some MB at most
_FOOTER = struct.Struct("<BQQQI")  # opcode, length, start of the summary, of its offsets, checksum
_MAGIC_BYTES, _CHECKSUM_BYTES = 8, 4
# What flipped bytes make of the reader; a checksum that does not fit is a ValueError.
DAMAGE = (McapError, ZstdError, struct.error, ValueError, OverflowError, MemoryError)


class McapStream:
    """Iterates over (topic, message); UnreadableLogError if it is not of the wanted profile.

    A chunk whose bytes have changed is left out: the index at the end of the file leads to the
    next one. Without that index the messages end where the file is cut off or damaged. Afterwards
    `complete`: whether the file had its proper end, `gaps` what could not be read, in
    nanoseconds since 1970.
    """

    def __init__(self, path: Path, profile: str) -> None:
        self._path = path
        self._profile = profile
        self.complete = False
        self.gaps: list[Gap] = []

    def __iter__(self) -> Iterator[tuple[str, Message]]:
        try:
            file = self._path.open("rb")
        except OSError as error:
            raise UnreadableLogError(f"{self._path}: cannot be read: {error.strerror}") from error
        with file:
            self._check_profile(file)
            summary = _read_summary(file)
            topics: dict[int, str] = {}
            if summary is None:
                records = self._from_start(file)
            else:
                topics = {number: channel.topic for number, channel in summary.channels.items()}
                records = self._by_index(file, summary)
            for record in records:
                if isinstance(record, Channel):
                    topics[record.id] = record.topic
                elif isinstance(record, Message) and record.channel_id in topics:
                    yield topics[record.channel_id], record

    def _check_profile(self, file: IO[bytes]) -> None:
        try:
            first = next(StreamReader(file, emit_chunks=True).records, None)
        except DAMAGE:
            first = None
        if not isinstance(first, Header) or first.profile != self._profile:
            kind = self._profile.removeprefix("tams-")
            raise UnreadableLogError(f"{self._path}: is not a TAMS {kind} log; give one of those")

    def _by_index(self, file: IO[bytes], summary: Summary) -> Iterator[McapRecord]:
        """Every chunk that is whole; one that is not becomes a gap."""
        self.complete = True
        for index in sorted(summary.chunk_indexes, key=attrgetter("chunk_start_offset")):
            try:
                yield from _whole_chunk(file, index)
            except DAMAGE:
                self.gaps.append(Gap(index.message_start_time, index.message_end_time))

    def _from_start(self, file: IO[bytes]) -> Iterator[McapRecord]:
        """The records up to where the file is cut off or damaged."""
        file.seek(0)
        reader = StreamReader(
            cast(IO[bytes], _WholeReads(file)),
            emit_chunks=True,
            validate_crcs=True,
            record_size_limit=_LIMIT_BYTES,
        )
        last_ns: int | None = None
        try:
            for outer in reader.records:
                for record in _unpacked(outer) if isinstance(outer, Chunk) else [outer]:
                    yield record
                    if isinstance(record, Message):
                        last_ns = max(last_ns or 0, record.log_time)
                self.complete = isinstance(outer, Footer)
        except EndOfFile:
            pass  # no footer was seen: the file stays incomplete
        except DAMAGE:
            self.gaps.append(Gap(last_ns, None))


def messages_between(path: Path, start_ns: int, end_ns: int) -> list[tuple[str, Message]] | None:
    """The topics and messages from `start_ns` until before `end_ns` [ns since 1970], as written.

    Without those in chunks that have changed; None if the log has no index. UnreadableLogError if
    the file cannot be read.
    """
    found = []
    try:
        with path.open("rb") as file:
            if (summary := _read_summary(file)) is None:
                return None
            for index in sorted(summary.chunk_indexes, key=attrgetter("chunk_start_offset")):
                if index.message_start_time >= end_ns or index.message_end_time < start_ns:
                    continue
                with suppress(*DAMAGE):
                    found += [one for one in _whole_chunk(file, index) if isinstance(one, Message)]
    except OSError as error:
        raise UnreadableLogError(f"{path}: cannot be read: {error.strerror}") from error
    return [
        (summary.channels[one.channel_id].topic, one)
        for one in found
        if start_ns <= one.log_time < end_ns
    ]


def _read_summary(file: IO[bytes]) -> Summary | None:
    """The index at the end of the file; None if it is not there or not as it was written."""
    try:
        file.seek(-_FOOTER.size - _MAGIC_BYTES, os.SEEK_END)
        *_, start, _, checksum = _FOOTER.unpack(file.read(_FOOTER.size))
        file.seek(start)
        checked = file.read()[: -_CHECKSUM_BYTES - _MAGIC_BYTES]
        if zlib.crc32(checked) != checksum:
            return None
        file.seek(0)
        return SeekingReader(file, record_size_limit=_LIMIT_BYTES).get_summary()
    except (*DAMAGE, OSError):  # OSError: shorter than a footer, or a start that is none
        return None


def _whole_chunk(file: IO[bytes], index: ChunkIndex) -> list[McapRecord]:
    """All records of a chunk; an error of `DAMAGE` if any byte of it has changed."""
    file.seek(index.chunk_start_offset)
    data = BytesIO(file.read(index.chunk_length))
    chunk = next(StreamReader(data, skip_magic=True, emit_chunks=True).records)
    if not isinstance(chunk, Chunk):
        raise McapError(f"a {type(chunk).__name__} where a chunk should be")
    return _unpacked(chunk)


def _unpacked(chunk: Chunk) -> list[McapRecord]:
    """Its records; an error of `DAMAGE` if a byte has changed, or it would take far too much."""
    size = chunk.uncompressed_size
    if chunk.compression == "zstd":  # which believes the frame's own size, if it has one
        size = max(size, frame_content_size(chunk.data))
    if size > _LIMIT_BYTES or chunk.compression not in ("", "zstd"):
        raise McapError(f"a chunk of {size} bytes that no TAMS has written")
    return breakup_chunk(chunk, validate_crc=True)


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


_VARINT, _FIXED64, _BYTES, _FIXED32 = 0, 1, 2, 5


def protobuf_fields(message: bytes) -> dict[int, int | bytes]:
    """The fields of a Foxglove message by number; of a repeated field the last value stays."""
    return dict(protobuf_parts(message))


def protobuf_parts(message: bytes) -> Iterator[tuple[int, int | bytes]]:
    """Each field's number and value: integers for varint and fixed fields, bytes for the rest.

    Just enough of the wire format: a field is a varint key (number << 3 | type) and its value
    (protobuf.dev, "Encoding"). Raises ValueError if `message` is damaged.
    """
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        number, kind = key >> 3, key & 7
        if kind == _VARINT:
            found, at = _varint(message, at)
            yield number, found
            continue
        if kind == _BYTES:
            size, at = _varint(message, at)
        elif kind in (_FIXED32, _FIXED64):
            size = 4 if kind == _FIXED32 else 8
        else:
            raise ValueError(f"unknown protobuf wire type {kind}")
        value = message[at : at + size]
        if len(value) < size:
            raise ValueError("the protobuf message is cut off")
        yield number, value if kind == _BYTES else int.from_bytes(value, "little")
        at += size


def _varint(message: bytes, at: int) -> tuple[int, int]:
    value = shift = 0
    while True:
        if at >= len(message):
            raise ValueError("the protobuf message is cut off")
        byte = message[at]
        at += 1
        value |= (byte & 0x7F) << shift
        if byte < 0x80:
            return value, at
        shift += 7
