"""The chunks of an MCAP file, made of the records that go into them, and what its summary tells.

Nothing of it grows with the length of the file: what the summary needs of each chunk is handed out
with the chunk. The format: https://mcap.dev/spec.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.records import (
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    McapRecord,
    Statistics,
    SummaryOffset,
)
from zstandard import ZstdCompressor

MAGIC = b"\x89MCAP0\r\n"
COMPRESSION = "zstd"
_RECORD = struct.Struct("<BQ")  # opcode, bytes that follow
_MESSAGE = struct.Struct("<HIQ")  # of a message: channel, sequence, log time
_MESSAGE_INDEX = struct.Struct("<BQHI")  # opcode, bytes that follow, channel, bytes of the entries
_ENTRY_BYTES = 16  # log time, offset in the chunk
_CHECKSUM_BYTES = 4  # the last of a footer, which cover what is before them


@dataclass(frozen=True, slots=True)
class FinishedChunk:
    """`data`: the chunk and the message indexes behind it; `index`: the record of the summary."""

    data: bytes
    index: bytes


class Chunks:
    """Takes schemas, channels and messages as records, in pieces of any size, and makes chunks."""

    def __init__(self) -> None:
        self._compressor = ZstdCompressor()
        self._records = bytearray()  # of the chunk that comes next
        self._whole_bytes = 0  # up to where they have been looked at
        self._entries: dict[int, list[int]] = {}  # by channel: log time, offset, log time, ...
        self._repeated: dict[Opcode, list[bytes]] = {Opcode.SCHEMA: [], Opcode.CHANNEL: []}
        self._counts: dict[int, int] = {}  # of messages, by channel
        self._chunk_count = 0
        self._first_ns: int | None = None
        self._last_ns = 0

    @property
    def waiting_bytes(self) -> int:
        """What has been received for the next chunk."""
        return len(self._records)

    def receive(self, data: bytes | bytearray) -> None:
        """The next bytes; a record may end in those after them."""
        records = self._records
        records += data
        start = self._whole_bytes
        while start + _RECORD.size <= len(records):
            opcode, length = _RECORD.unpack_from(records, start)
            content, end = start + _RECORD.size, start + _RECORD.size + length
            if end > len(records):
                break
            if opcode == Opcode.MESSAGE:
                channel, _, time_ns = _MESSAGE.unpack_from(records, content)
                self._entries.setdefault(channel, []).extend((time_ns, start))
            else:
                self._repeated[opcode].append(bytes(records[start:end]))
            start = end
        self._whole_bytes = start

    def finish(self, offset: int) -> FinishedChunk | None:
        """What was received as a chunk that begins at `offset` of the file; None if it is nothing.

        It must end with a record's end.
        """
        if not self._records:
            return None
        records, entries = self._records, dict(sorted(self._entries.items()))
        self._records, self._whole_bytes, self._entries = bytearray(), 0, {}
        times = [time_ns for one in entries.values() for time_ns in one[::2]]
        first_ns, last_ns = min(times, default=0), max(times, default=0)
        self._count(entries, first_ns, last_ns)
        compressed = self._compressor.compress(records)
        chunk = _bytes_of(
            Chunk(
                compression=COMPRESSION,
                data=compressed,
                message_start_time=first_ns,
                message_end_time=last_ns,
                uncompressed_crc=zlib.crc32(records),
                uncompressed_size=len(records),
            )
        )
        indexes, offsets, next_offset = [], {}, offset + len(chunk)
        for channel, numbers in entries.items():
            indexes.append(_message_index(channel, numbers))
            offsets[channel] = next_offset
            next_offset += len(indexes[-1])
        index = ChunkIndex(
            chunk_length=len(chunk),
            chunk_start_offset=offset,
            compression=COMPRESSION,
            compressed_size=len(compressed),
            message_end_time=last_ns,
            message_index_length=next_offset - offset - len(chunk),
            message_index_offsets=offsets,
            message_start_time=first_ns,
            uncompressed_size=len(records),
        )
        return FinishedChunk(b"".join((chunk, *indexes)), _bytes_of(index))

    def ending(self, offset: int, checksum: int, indexes: bytes) -> bytes:
        """All that comes behind the last chunk: end of data, summary, footer.

        `offset`: where it begins in the file; `checksum`: CRC-32 of all before; `indexes`: those
        of the finished chunks, one behind the other.
        """
        ending = bytearray(_bytes_of(DataEnd(checksum)))
        summary_from = len(ending)
        group_offsets = b""
        for opcode, group in (
            (Opcode.SCHEMA, b"".join(self._repeated[Opcode.SCHEMA])),
            (Opcode.CHANNEL, b"".join(self._repeated[Opcode.CHANNEL])),
            (Opcode.STATISTICS, _bytes_of(self._statistics())),
            (Opcode.CHUNK_INDEX, indexes),
        ):
            if group:
                group_offsets += _bytes_of(SummaryOffset(opcode, offset + len(ending), len(group)))
            ending += group
        footer = Footer(offset + summary_from, offset + len(ending), summary_crc=0)
        ending += group_offsets + _bytes_of(footer)[:-_CHECKSUM_BYTES]
        summary_checksum = zlib.crc32(memoryview(ending)[summary_from:])
        return bytes(ending) + summary_checksum.to_bytes(_CHECKSUM_BYTES, "little") + MAGIC

    def _count(self, entries: dict[int, list[int]], first_ns: int, last_ns: int) -> None:
        self._chunk_count += 1
        if not entries:
            return
        for channel, numbers in entries.items():
            self._counts[channel] = self._counts.get(channel, 0) + len(numbers) // 2
        self._first_ns = first_ns if self._first_ns is None else min(first_ns, self._first_ns)
        self._last_ns = max(last_ns, self._last_ns)

    def _statistics(self) -> Statistics:
        return Statistics(
            attachment_count=0,
            channel_count=len(self._repeated[Opcode.CHANNEL]),
            channel_message_counts=dict(sorted(self._counts.items())),
            chunk_count=self._chunk_count,
            message_count=sum(self._counts.values()),
            message_end_time=self._last_ns,
            message_start_time=self._first_ns or 0,
            metadata_count=0,
            schema_count=len(self._repeated[Opcode.SCHEMA]),
        )


def _message_index(channel: int, numbers: list[int]) -> bytes:
    """Where each message of a channel is in its chunk; mcap's own takes 1 µs a message more."""
    entries_bytes = len(numbers) // 2 * _ENTRY_BYTES
    head = _MESSAGE_INDEX.pack(
        Opcode.MESSAGE_INDEX,
        _MESSAGE_INDEX.size - _RECORD.size + entries_bytes,
        channel,
        entries_bytes,
    )
    return head + struct.pack(f"<{len(numbers)}Q", *numbers)


def _bytes_of(record: McapRecord) -> bytes:
    builder = RecordBuilder()
    record.write(builder)
    return bytes(builder.end())  # type: ignore[no-untyped-call]
