"""Adds the index of the chunks to a finished MCAP file.

The SDK would keep that index in memory until it closes the file: about 1 kB for each chunk, so a
session that never ends would grow for ever. Everything that is in it can be read from the file.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.records import ChunkIndex, Footer, SummaryOffset

MAGIC = b"\x89MCAP0\r\n"
_HEAD = struct.Struct("<BQ")  # of every record: opcode, length of what follows
_FOOTER_BYTES = _HEAD.size + 20
_CHECKSUM_BYTES = 4


def add_chunk_indexes(path: Path) -> None:
    """Write the chunk indexes into the summary of the complete file at `path`, which has none.

    OSError if the disk refuses.
    """
    with path.open("r+b") as file:
        footer = _read_footer(file)
        file.seek(footer.summary_start)
        summary = file.read(footer.summary_offset_start - footer.summary_start)
        offsets = file.read()[: -_FOOTER_BYTES - len(MAGIC)]
        group = _written(chunk_indexes(file, footer.summary_start))
        if not group:
            return
        offset = SummaryOffset(Opcode.CHUNK_INDEX, footer.summary_offset_start, len(group))
        offsets += _written([offset])
        moved = Footer(footer.summary_start, footer.summary_offset_start + len(group), 0)
        end = _written([moved])[:-_CHECKSUM_BYTES]
        content = summary + group + offsets + end
        checksum = zlib.crc32(content).to_bytes(_CHECKSUM_BYTES, "little")
        file.truncate(footer.summary_start)  # so that what is cut off later looks cut off
        file.seek(footer.summary_start)
        file.write(content + checksum + MAGIC)


def chunk_indexes(file: IO[bytes], end: int) -> Iterator[ChunkIndex]:
    """The index of each chunk before the byte `end`, from the heads of the records."""
    found: ChunkIndex | None = None
    position = len(MAGIC)
    while position < end:
        file.seek(position)
        opcode, length = _HEAD.unpack(file.read(_HEAD.size))
        following = position + _HEAD.size + length
        if opcode == Opcode.MESSAGE_INDEX and found is not None:
            found.message_index_offsets[ReadDataStream(file).read2()] = position
            found.message_index_length += following - position
        elif found is not None:
            yield found
            found = None
        if opcode == Opcode.CHUNK:
            found = _index_of_chunk(ReadDataStream(file), position, following)
        position = following
    if found is not None:
        yield found


def _index_of_chunk(head: ReadDataStream, start: int, end: int) -> ChunkIndex:
    start_ns, end_ns, uncompressed = head.read8(), head.read8(), head.read8()
    head.read4()  # its checksum
    return ChunkIndex(
        chunk_start_offset=start,
        chunk_length=end - start,
        message_start_time=start_ns,
        message_end_time=end_ns,
        uncompressed_size=uncompressed,
        compression=head.read_prefixed_string(),
        compressed_size=head.read8(),
        message_index_offsets={},
        message_index_length=0,
    )


def _read_footer(file: IO[bytes]) -> Footer:
    file.seek(-_FOOTER_BYTES - len(MAGIC) + _HEAD.size, os.SEEK_END)
    footer: Footer = Footer.read(ReadDataStream(file))
    return footer


def _written(records: Iterator[ChunkIndex] | list[SummaryOffset] | list[Footer]) -> bytes:
    builder = RecordBuilder()
    for record in records:
        record.write(builder)
    data: bytes = builder.end()  # type: ignore[no-untyped-call]
    return data
