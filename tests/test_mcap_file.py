"""The MCAP files written: what their end says of them is so, and nothing of it waits in memory."""

from __future__ import annotations

import errno
import os
import struct
import tempfile
import tracemalloc
import zlib
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import pytest
from foxglove import Context, Schema, open_mcap
from foxglove.mcap import MCAPWriteOptions
from hypothesis import given, settings
from hypothesis import strategies as st
from mcap.data_stream import ReadDataStream, RecordBuilder
from mcap.opcode import Opcode
from mcap.reader import SeekingReader
from mcap.records import (
    Channel,
    Chunk,
    ChunkIndex,
    DataEnd,
    Footer,
    Message,
    MessageIndex,
    Statistics,
    SummaryOffset,
)
from mcap.records import Schema as SchemaRecord
from mcap.stream_reader import StreamReader, breakup_chunk
from mcap.summary import Summary

from tams_app.errors import LogError
from tams_app.recording.disk import ScratchFile
from tams_app.recording.mcap_chunks import MAGIC, Chunks
from tams_app.recording.mcap_file import CHUNK_BYTES, McapFile
from tams_app.recording.mcap_log import McapLog
from tams_app.recording.mcap_stream import McapStream
from tams_app.records import EncodedFrame
from tests.synthetic_session import START_NS, header

pytestmark = pytest.mark.untimed

PROFILE = "test"
FIRST_NS = 1_800_000_000_000_000_000


@dataclass(frozen=True)
class Said:
    """A message; `None` in a list of these: the chunk is finished here."""

    channel: int
    after_first_ns: int
    size_bytes: int

    @property
    def data(self) -> bytes:
        return (b"%d %d " % (self.channel, self.after_first_ns)).ljust(self.size_bytes, b".")


Script = list[Said | None]
scripts = st.lists(
    st.one_of(
        st.builds(Said, st.integers(0, 5), st.integers(0, 10**10), st.integers(0, 20_000)),
        st.none(),
    ),
    max_size=60,
)


class Talk:
    """Logs a script in a context of its own, one schema for two channels each."""

    def __init__(self) -> None:
        self.context = Context()
        self._channels: dict[int, Any] = {}

    def run(self, script: Script, writer: Any) -> None:
        for said in script:
            if said is None:
                writer.flush()
                continue
            self._channel(said.channel).log(said.data, FIRST_NS + said.after_first_ns)

    def _channel(self, number: int) -> Any:
        if number not in self._channels:
            schema = Schema(name=f"S{number // 2}", encoding="jsonschema", data=b"{}")
            self._channels[number] = self.context._create_channel(
                f"/{number}", message_encoding="json", schema=schema
            )
        return self._channels[number]


def written(script: Script) -> bytes:
    talk = Talk()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.mcap"
        file = McapFile(path, talk.context, PROFILE)
        talk.run(script, file)
        file.close()
        return path.read_bytes()


def written_by_the_sdk(script: Script) -> bytes:
    talk = Talk()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "log.mcap"
        writer = open_mcap(
            path, context=talk.context, writer_options=MCAPWriteOptions(profile=PROFILE)
        )
        talk.run(script, writer)
        writer.close()
        return path.read_bytes()


def records_of(data: bytes) -> Iterator[tuple[int, int, bytes]]:
    """Where each record of a file begins, its opcode and its content, by a scan of its own."""
    assert data.startswith(MAGIC)
    assert data.endswith(MAGIC)
    at = len(MAGIC)
    while at < len(data) - len(MAGIC):
        opcode, length = struct.unpack_from("<BQ", data, at)
        yield at, opcode, data[at + 9 : at + 9 + length]
        at += 9 + length
    assert at == len(data) - len(MAGIC)


def read(kind: Any, content: bytes) -> Any:
    return kind.read(ReadDataStream(BytesIO(content)))


def summary_of(data: bytes) -> Summary:
    summary = SeekingReader(BytesIO(data), validate_crcs=True).get_summary()
    assert summary is not None
    return summary


def messages_of(data: bytes) -> list[Message]:
    records = StreamReader(BytesIO(data), validate_crcs=True).records
    return [record for record in records if isinstance(record, Message)]


@settings(deadline=None, max_examples=60)
@given(scripts)
def test_a_file_holds_what_was_logged_in_its_order(script: Script) -> None:
    expected = [(FIRST_NS + said.after_first_ns, said.data) for said in script if said]
    found = [(message.log_time, message.data) for message in messages_of(written(script))]
    assert found == expected


@settings(deadline=None, max_examples=60)
@given(scripts)
def test_the_summary_of_a_finished_file_is_what_a_scan_of_it_finds(script: Script) -> None:
    data = written(script)
    records = list(records_of(data))
    summary = summary_of(data)
    messages = messages_of(data)
    times = [message.log_time for message in messages]
    inside = [
        record
        for _, opcode, content in records
        if opcode == Opcode.CHUNK
        for record in breakup_chunk(read(Chunk, content), validate_crc=True)
    ]
    schemas = {record.id: record for record in inside if isinstance(record, SchemaRecord)}
    channels = {record.id: record for record in inside if isinstance(record, Channel)}
    chunk_places = [at for at, opcode, _ in records if opcode == Opcode.CHUNK]
    assert summary.statistics == Statistics(
        attachment_count=0,
        channel_count=len(channels),
        channel_message_counts=dict(Counter(message.channel_id for message in messages)),
        chunk_count=len(chunk_places),
        message_count=len(messages),
        message_end_time=max(times, default=0),
        message_start_time=min(times, default=0),
        metadata_count=0,
        schema_count=len(schemas),
    )
    assert (summary.schemas, summary.channels) == (schemas, channels)
    assert [index.chunk_start_offset for index in summary.chunk_indexes] == chunk_places


@settings(deadline=None, max_examples=60)
@given(scripts)
def test_each_chunk_index_leads_to_every_message_of_its_chunk(script: Script) -> None:
    data = written(script)
    records = {at: (opcode, content) for at, opcode, content in records_of(data)}
    for index in summary_of(data).chunk_indexes:
        chunk = chunk_at(records, index)
        times = [record.log_time for record in messages_in(chunk)]
        assert (index.message_start_time, index.message_end_time) == (min(times), max(times))
        assert (chunk.message_start_time, chunk.message_end_time) == (min(times), max(times))
        assert (index.compressed_size, index.uncompressed_size) == (
            len(chunk.data),
            chunk.uncompressed_size,
        )
        indexes_end = index.chunk_start_offset + index.chunk_length + index.message_index_length
        assert records[indexes_end][0] != Opcode.MESSAGE_INDEX
        plain = b"".join(plain_records(chunk))
        found = []
        for channel, place in index.message_index_offsets.items():
            opcode, content = records[place]
            assert opcode == Opcode.MESSAGE_INDEX
            assert index.chunk_start_offset + index.chunk_length <= place < indexes_end
            entries = read(MessageIndex, content)
            assert entries.channel_id == channel
            found += [(channel, *entry) for entry in entries.records]
        for channel, time_ns, offset in found:
            opcode, _, channel_there, _, time_there = struct.unpack_from("<BQHIQ", plain, offset)
            assert (opcode, channel_there, time_there) == (Opcode.MESSAGE, channel, time_ns)
        assert len({offset for *_, offset in found}) == len(found) == len(times)


def chunk_at(records: dict[int, tuple[int, bytes]], index: ChunkIndex) -> Chunk:
    opcode, content = records[index.chunk_start_offset]
    assert opcode == Opcode.CHUNK
    assert index.chunk_length == len(content) + 9
    chunk = read(Chunk, content)
    assert isinstance(chunk, Chunk)
    return chunk


def messages_in(chunk: Chunk) -> list[Message]:
    return [record for record in breakup_chunk(chunk, True) if isinstance(record, Message)]


def plain_records(chunk: Chunk) -> Iterator[bytes]:
    for record in breakup_chunk(chunk, validate_crc=True):
        builder = RecordBuilder()
        record.write(builder)
        yield bytes(builder.end())


@settings(deadline=None, max_examples=60)
@given(scripts)
def test_the_end_of_a_file_is_in_groups_that_its_offsets_name_and_its_checksums_cover(
    script: Script,
) -> None:
    data = written(script)
    records = list(records_of(data))
    ((end_at, data_end),) = ((at, c) for at, opcode, c in records if opcode == Opcode.DATA_END)
    assert read(DataEnd, data_end).data_section_crc == zlib.crc32(data[:end_at])
    footer = read(Footer, records[-1][2])
    assert footer.summary_crc == zlib.crc32(data[footer.summary_start : -len(MAGIC) - 4])
    place = footer.summary_start
    for _, opcode, content in records:
        if opcode != Opcode.SUMMARY_OFFSET:
            continue
        group = read(SummaryOffset, content)
        assert group.group_start == place
        place += group.group_length
        inside = [kind for at, kind, _ in records if group.group_start <= at < place]
        assert set(inside) == {group.group_opcode}
    assert place == footer.summary_offset_start


@settings(deadline=None, max_examples=40)
@given(scripts)
def test_the_summary_says_what_the_sdk_says_of_the_same_chunks(script: Script) -> None:
    ours, theirs = summary_of(written(script)), summary_of(written_by_the_sdk(script))
    assert ours.statistics == theirs.statistics
    assert (ours.schemas, ours.channels) == (theirs.schemas, theirs.channels)
    assert [in_both(index) for index in ours.chunk_indexes] == [
        in_both(index) for index in theirs.chunk_indexes
    ]


def in_both(index: ChunkIndex) -> tuple[Any, ...]:
    """Of an index, all that does not follow from how well its chunk was compressed."""
    offsets = index.message_index_offsets
    return (
        index.message_start_time,
        index.message_end_time,
        {channel: place - min(offsets.values()) for channel, place in offsets.items()},
        index.message_index_length,
        index.compression,
        index.uncompressed_size,
    )


@settings(deadline=None, max_examples=40)
@given(scripts, st.integers(0, 10**10), st.integers(0, 10**10))
def test_a_stretch_of_time_can_be_sought(script: Script, first_ns: int, length_ns: int) -> None:
    end_ns = first_ns + length_ns
    reader = SeekingReader(BytesIO(written(script)))
    sought = reader.iter_messages(
        starting_at=FIRST_NS + first_ns, ending_before=FIRST_NS + end_ns, topics=["/0", "/3"]
    )
    expected = sorted(
        (said.after_first_ns, said.data)
        for said in script
        if said and said.channel in (0, 3) and first_ns <= said.after_first_ns < end_ns
    )
    found = [(message.log_time - FIRST_NS, message.data) for *_, message in sought]
    assert sorted(found) == expected


@settings(deadline=None, max_examples=60)
@given(scripts, st.floats(0, 1))
def test_a_file_cut_anywhere_reads_up_to_its_last_whole_chunk(script: Script, part: float) -> None:
    data = written([Said(0, 0, 1), None, *script])
    chunk_ends = [
        index.chunk_start_offset + index.chunk_length for index in summary_of(data).chunk_indexes
    ]
    cut = chunk_ends[0] + int((len(data) - 1 - chunk_ends[0]) * part)
    messages = [message.data for message in messages_of(data)]
    whole_chunks = sum(end <= cut for end in chunk_ends)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "cut.mcap"
        path.write_bytes(data[:cut])
        stream = McapStream(path, PROFILE)
        found = [message.data for _, message in stream]
    counts = [len(messages_in(chunk)) for chunk in chunks_of(data)]
    assert found == messages[: sum(counts[:whole_chunks])]
    assert not stream.gaps


def chunks_of(data: bytes) -> list[Chunk]:
    return [
        read(Chunk, content) for _, opcode, content in records_of(data) if opcode == Opcode.CHUNK
    ]


def test_while_it_is_written_a_log_is_the_only_file_of_its_folder(tmp_path: Path) -> None:
    talk = Talk()
    file = McapFile(tmp_path / "log.mcap", talk.context, PROFILE)
    talk.run([Said(0, 1, 10), None, Said(1, 2, 10), None], file)
    assert [path.name for path in tmp_path.iterdir()] == ["log.mcap"]
    file.close()
    assert [path.name for path in tmp_path.iterdir()] == ["log.mcap"]


def test_chunks_leave_nothing_in_memory() -> None:
    chunks = Chunks()
    record = struct.pack("<BQHIQQ", Opcode.MESSAGE, 22 + 400, 0, 0, FIRST_NS, FIRST_NS) + bytes(400)
    record_of = [record[:9] + struct.pack("<H", number) + record[11:] for number in range(25)]

    def make(count: int) -> None:
        for _ in range(count):
            for one in record_of:
                chunks.receive(one)
            assert chunks.finish(1 << 40) is not None

    make(20)
    tracemalloc.start()
    try:
        make(20)
        before, _ = tracemalloc.get_traced_memory()
        make(400)
        after, _ = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert after - before < 400 * 10  # bytes; an index of a chunk has 300 as it is written


def test_a_burst_is_written_in_chunks_of_a_size_that_readers_like(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    log = McapLog(path, header())
    frame_bytes = CHUNK_BYTES // 3
    for index in range(20):
        data = os.urandom(frame_bytes)
        log.write(EncodedFrame("eih", index, START_NS, START_NS + index, True, data), START_NS)
    log.close()
    sizes = [index.uncompressed_size for index in summary_of(path.read_bytes()).chunk_indexes]
    assert len(sizes) >= 6
    assert max(sizes) < CHUNK_BYTES + 2 * frame_bytes


@pytest.mark.parametrize("part", ["write", "read"])
def test_where_the_indexes_are_lost_the_log_ends_but_stays_readable(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, part: str
) -> None:
    path = tmp_path / "log.mcap"
    talk = Talk()
    file = McapFile(path, talk.context, PROFILE)
    talk.run([Said(0, 1, 10), None, Said(0, 2, 10), None], file)

    def refuse(*_: Any) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(ScratchFile, part, refuse)
    talk.run([Said(0, 3, 10)], file)
    if part == "write":
        with pytest.raises(LogError, match=r"cannot be written any more: No space left.* readable"):
            file.flush()
        talk.run([Said(0, 4, 10)], file)
    file.close()
    stream = McapStream(path, PROFILE)
    assert [message.log_time - FIRST_NS for _, message in stream] == [1, 2, 3]
    assert not stream.complete
    assert not stream.gaps


def test_a_folder_that_takes_no_file_is_refused_and_stays_as_it_was(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(**_: Any) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS))

    monkeypatch.setattr(tempfile, "TemporaryFile", refuse)
    with pytest.raises(LogError, match=r"the log folder cannot be used: Read-only file system"):
        McapFile(tmp_path / "log.mcap", Context(), PROFILE)
    assert list(tmp_path.iterdir()) == []
