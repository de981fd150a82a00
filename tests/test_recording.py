"""The recorder and its readers: what goes in comes out, also after a crash and on a full disk."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from queue import Queue
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from mcap.reader import make_reader
from mcap.records import ChunkIndex

from tams_app import records
from tams_app.errors import LogError
from tams_app.recording import (
    Facts,
    FrameCaptured,
    FrameShown,
    Recorder,
    journal,
    mcap_log,
    read_log,
    read_video,
    topics,
)
from tams_app.recording.codec import Codec
from tams_app.recording.mcap_log import McapLog
from tams_app.recording.reference import ReferenceRecorder, read_reference
from tams_app.recording.topics import HEADER, TOPICS, Gap, damage_sentence
from tams_app.records import (
    Allocation,
    DroppedFrame,
    EncodedFrame,
    Frame,
    FrameQuality,
    LinkCapacity,
    Note,
    Outcome,
    PacketFate,
    PacketKind,
    PacketRecord,
    Phase,
    PhaseChange,
    Pose,
    Record,
    SceneTruth,
    ShownFrame,
    StopRecord,
    SystemSample,
    Tick,
    TimeNs,
    UplinkSummary,
)
from tams_app.rotation import Rotation
from tams_app.runtime.clock import MonotonicClock, VirtualClock
from tams_app.summary import summarise
from tams_app.units import NS_PER_S
from tests.faults.applications import until
from tests.file_size_limit import file_size_limit
from tests.further import further
from tests.synthetic_session import START_NS, header, live_records, never_fails, tick

pytestmark = pytest.mark.waiting

PROJECT = Path(__file__).resolve().parent.parent
POSE = Pose(np.array([0.3, -0.1, 0.02]), Rotation.from_quat([0.0, 0.6, 0.0, 0.8]))


def record_all(path: Path, items: list[Any], **changes: Any) -> None:
    recorder = Recorder(McapLog(path, header(**changes)), MonotonicClock(), never_fails)
    recorder.start()
    for item in items:
        recorder.record(item)
    recorder.close()
    assert recorder.dropped == 0


def one_of_each() -> list[Any]:
    image = np.zeros((4, 6, 3), np.uint8)
    t = START_NS
    return [
        tick(3),
        PhaseChange(t, Phase.ALIGN, "line 7"),
        Allocation(t, Phase.ALIGN, 6000.0, 5520.0, {"eih": 3000, "gt": 1260, "gs": 1260}),
        LinkCapacity(t, 6000.0),
        UplinkSummary(t, 9000, 7, 2, 6000, t - 5, 3, {"gt": 0.25}, {"gt": None}),
        Frame("eih", 4, t + 1, image),
        EncodedFrame("eih", 4, t + 1, t + 9, True, b"\0\0\0\1\x65abc"),
        DroppedFrame("gs", 5, t + 2),
        ShownFrame("eih", 4, t + 77, image, t, True),
        PacketRecord(
            "gt", PacketKind.REPAIR, 65535, 1228, t, t + 5, t + 9, PacketFate.DELIVERED, 12000
        ),
        PacketRecord("gt", PacketKind.RTCP, 0, 80, t, 0, 0, PacketFate.OVERFLOW),
        StopRecord("pose frozen", t, None),
        Note(t, "warning", "no real-time priority: run as described in the guide"),
        SystemSample(t, 61.5, {"render": 30.0}, 412.0),
        SceneTruth(t, POSE, POSE, POSE, 0.02, 0.016),
        FrameQuality("eih", 4, t, None, 80, False, None, None, 0.5, 0.25),
        Facts(t, {"scheduler": "fifo"}),
        Outcome(True, False, None, 2, "three drops"),
    ]


def same(left: Any, right: Any) -> bool:
    """Equality of records with arrays and rotations in them, by their JSON."""
    return type(left) is type(right) and Codec(type(left)).encode(left) == Codec(
        type(right)
    ).encode(right)


def test_every_record_comes_back_as_it_went_in(tmp_path: Path) -> None:
    items = one_of_each()
    record_all(tmp_path / "session.mcap", items)
    log = read_log(tmp_path / "session.mcap")
    by_type = {type(item): item for item in items}
    assert same(log.header, header())
    for kind, name in topics._LISTS.items():
        if kind in by_type:
            (back,) = getattr(log, name)
            assert same(back, by_type[kind])
    assert log.captured == [FrameCaptured("eih", 4, START_NS + 1)]
    assert log.shown == [FrameShown("eih", 4, START_NS + 77, True)]
    assert log.packets == [item for item in items if isinstance(item, PacketRecord)]
    assert log.facts == {"scheduler": "fifo"}
    assert log.outcome == by_type[Outcome]
    assert not log.truncated
    (sent,) = log.sent
    assert (sent.index, sent.keyframe, sent.size_bytes) == (4, True, 8)
    assert list(read_video(tmp_path / "session.mcap", "eih")) == [by_type[EncodedFrame]]


def test_any_mcap_reader_sees_dates_schemas_and_foxglove_video(tmp_path: Path) -> None:
    record_all(tmp_path / "session.mcap", one_of_each())
    with (tmp_path / "session.mcap").open("rb") as stream:
        found = {
            channel.topic: (schema, message)
            for schema, channel, message in make_reader(stream).iter_messages()
        }
    schema, message = found["/tick"]
    assert schema is not None
    assert schema.encoding == "jsonschema"
    assert message.log_time == tick(3).started_ns + header().wall_offset_ns
    video_schema, _ = found["/video/eih"]
    assert video_schema is not None
    assert video_schema.name == "foxglove.CompressedVideo"


def test_a_number_that_is_not_finite_stays_valid_json_and_reads_as_nan() -> None:
    codec = Codec(Tick)
    data = codec.encode(replace(tick(1), speed=math.inf, vertical_speed=math.nan))
    assert b"Infinity" not in data
    assert b"NaN" not in data
    assert math.isnan(codec.decode(data).speed)
    assert codec.decode(data).speed_scale == 1.0


@dataclass(frozen=True, slots=True)
class Undescribed(Record):
    t_ns: TimeNs
    number: int


def test_a_field_whose_hint_does_not_say_what_it_means_cannot_be_recorded() -> None:
    with pytest.raises(TypeError, match=r"Undescribed\.number is not described"):
        Codec(Undescribed)


def test_every_record_has_a_topic_or_comes_back_out_of_another_form() -> None:
    named = [*vars(records).values(), *vars(topics).values()]
    kinds = {one for one in named if isinstance(one, type) and issubclass(one, Record)} - {Record}
    in_another_form = {Frame, EncodedFrame, ShownFrame, PacketRecord, Outcome}
    assert kinds - set(TOPICS) == in_another_form
    assert in_another_form < {type(item) for item in one_of_each()}  # which all come back


def test_two_recorders_of_one_process_do_not_mix(tmp_path: Path) -> None:
    recorders = [
        Recorder(
            McapLog(tmp_path / f"{name}.mcap", header(name=name)), MonotonicClock(), never_fails
        )
        for name in ("one", "two")
    ]
    for recorder in recorders:
        recorder.start()
    for number in range(100):
        recorders[number % 2].record(tick(number))
    for recorder in recorders:
        recorder.close()
    first, second = (read_log(tmp_path / f"{name}.mcap") for name in ("one", "two"))
    assert (first.header.name, second.header.name) == ("one", "two")
    assert [record.link.sent for record in first.ticks] == list(range(0, 100, 2))
    assert [record.link.sent for record in second.ticks] == list(range(1, 100, 2))


def test_what_a_kill_would_leave_is_readable_up_to_the_last_second(tmp_path: Path) -> None:
    path, clock = tmp_path / "session.mcap", VirtualClock(START_NS)
    recorder = Recorder(McapLog(path, header()), clock, never_fails)
    recorder.start()
    recorder.record(tick(0))
    until(lambda: len(read_log(path).ticks) == 1, "the first flush")
    for number in range(1, 240):
        recorder.record(tick(number))
    time.sleep(5 * journal.POLL_S)  # turns of the thread in which it could flush
    assert len(read_log(path).ticks) == 1, "the next flush is not due"
    assert journal.FLUSH_NS < NS_PER_S
    clock.advance_ns(journal.FLUSH_NS)
    until(lambda: len(read_log(path).ticks) == 240, "what was recorded to be on the disk")
    log = read_log(path)
    recorder.close()
    assert log.truncated
    assert [record.link.sent for record in log.ticks] == list(range(240))


@pytest.mark.parametrize("kept", [0.3, 0.55, 0.8, 0.99])
def test_a_log_cut_anywhere_gives_what_is_before_the_cut(tmp_path: Path, kept: float) -> None:
    data = long_log(tmp_path / "whole.mcap")
    cut = tmp_path / "cut.mcap"
    cut.write_bytes(data[: int(len(data) * kept)])
    log = read_log(cut)
    assert log.truncated
    assert not log.gaps
    assert [record.link.sent for record in log.ticks] == list(range(len(log.ticks)))


def long_log(path: Path) -> bytes:
    written = McapLog(path, header())
    for number in range(600):
        written.write(tick(number), 0)
        if number % 100 == 99:
            written.flush()
    written.close()
    return path.read_bytes()


def test_a_log_can_be_read_for_some_of_its_records(tmp_path: Path) -> None:
    long_log(tmp_path / "session.mcap")
    whole = read_log(tmp_path / "session.mcap")
    assert len(whole.ticks) == 600
    without = read_log(tmp_path / "session.mcap", only=(Note,))
    assert without.ticks == []
    assert (without.header.name, without.complete) == (whole.header.name, True)
    assert without.ended_ns == whole.ended_ns


@pytest.mark.parametrize(("flips", "least"), [(4, 2), *further((60, 41))])
def test_a_flipped_bit_anywhere_is_told_as_damage_and_never_read_as_data(
    tmp_path: Path, flips: int, least: int
) -> None:
    data = long_log(tmp_path / "whole.mcap")
    random = np.random.default_rng(4)
    flipped = tmp_path / "flipped.mcap"
    told = 0
    for at in random.integers(2000, len(data) * 9 // 10, flips):  # in the chunks behind the header
        flipped.write_bytes(data[:at] + bytes([data[at] ^ 4]) + data[at + 1 :])
        log = read_log(flipped)
        told += not log.complete
        numbers = [record.link.sent for record in log.ticks]
        # damage between chunks is told, and loses nothing
        assert numbers == list(range(600)) or not log.complete
        assert sorted(set(numbers)) == numbers
        assert len(numbers) >= 500  # of six chunks one at most is lost
        assert all(same(record, tick(record.link.sent)) for record in log.ticks[::25])
    assert told >= least


def chunks(path: Path) -> list[ChunkIndex]:
    with path.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    return sorted(summary.chunk_indexes, key=lambda chunk: chunk.chunk_start_offset)


def test_of_a_bad_chunk_only_its_own_records_are_missing_and_their_time_is_told(
    tmp_path: Path,
) -> None:
    path = tmp_path / "session.mcap"
    data = bytearray(long_log(path))
    header_chunk, *_, bad, last = chunks(path)
    assert header_chunk.chunk_start_offset < bad.chunk_start_offset < last.chunk_start_offset
    data[bad.chunk_start_offset + bad.chunk_length // 2] ^= 4
    path.write_bytes(data)
    log = read_log(path)
    kept = [record.link.sent for record in log.ticks]
    assert kept == [*range(400), *range(500, 600)]
    assert log.gaps == [Gap(tick(400).started_ns, tick(499).started_ns)]
    assert not log.truncated
    assert not log.complete


def test_where_the_index_is_damaged_too_the_log_is_read_from_its_beginning(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    data = bytearray(long_log(path))
    bad = chunks(path)[-2]
    data[-60] ^= 4
    path.write_bytes(data)
    assert len(read_log(path).ticks) == 600
    data[bad.chunk_start_offset + bad.chunk_length // 2] ^= 4
    path.write_bytes(data)
    log = read_log(path)
    assert [record.link.sent for record in log.ticks] == list(range(400))
    assert log.gaps == [Gap(tick(399).started_ns, None)]


def test_no_frame_gets_the_bytes_of_another_where_a_chunk_is_missing(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    written = McapLog(path, header())
    for index in range(6):
        frame = EncodedFrame("eih", index, START_NS, START_NS + index, True, bytes([index]))
        written.write(frame, 0)
        written.flush()
    written.close()
    data = path.read_bytes()
    for chunk in chunks(path)[1:]:
        damaged = bytearray(data)
        damaged[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 4
        path.write_bytes(damaged)
        frames = list(read_video(path, "eih"))
        assert len(frames) == 5
        assert all(frame.data == bytes([frame.index]) for frame in frames)


def test_the_document_of_the_log_names_every_key_of_the_summary(tmp_path: Path) -> None:
    text = (PROJECT / "docs" / "LOG.md").read_text(encoding="utf-8")
    record_all(tmp_path / "session.mcap", list(live_records(2.0)))
    summary = summarise(read_log(tmp_path / "session.mcap"))
    unnamed = [key for key in _keys(summary) if f"`{key}`" not in text and key not in _BY_NAME]
    assert unnamed == []


_BY_NAME = {*Phase, "eih", "gt", "gs", "p50", "p95", "p99", "p99_9", "max", "reach"}


def _keys(tree: Any) -> Iterator[str]:
    if isinstance(tree, list):
        for item in tree:
            yield from _keys(item)
    for key in tree if isinstance(tree, dict) else ():
        yield key
        yield from _keys(tree[key])


def test_damage_of_the_first_chunk_is_told_as_damage(tmp_path: Path) -> None:
    data = bytearray(long_log(tmp_path / "whole.mcap"))
    data[300] ^= 4
    (tmp_path / "flipped.mcap").write_bytes(data)
    with pytest.raises(LogError, match="is damaged at its beginning"):
        read_log(tmp_path / "flipped.mcap")


def ends_with_a_whole_record(path: Path) -> bool:
    """Whether any MCAP tool can read to the very end (records: opcode, u64 length, content)."""
    data = path.read_bytes()
    at = 8  # the magic
    while at < len(data):
        at += 9 + int.from_bytes(data[at + 1 : at + 9], "little")
    return at == len(data)


def test_a_full_disk_is_told_in_one_sentence_and_the_log_stays_readable(tmp_path: Path) -> None:
    path = tmp_path / "session.mcap"
    failed: Queue[BaseException] = Queue()
    with file_size_limit(400_000):
        log = McapLog(path, header())
        recorder = Recorder(log, MonotonicClock(), lambda _, why: failed.put(why))
        recorder.start()
        for item in live_records(4.0):
            recorder.record(item)
            if isinstance(item, Tick) and item.link.sent == 59:
                until(lambda: path.stat().st_size > 50_000, "a flush before the disk is full")
        failure = failed.get(timeout=20)
        recorder.close()
    assert isinstance(failure, LogError)
    assert "the log cannot be written any more" in str(failure)
    assert str(failure).endswith("is readable")
    assert "\n" not in str(failure)
    assert recorder.failure is failure
    log = read_log(path)
    assert log.truncated
    assert len(log.ticks) > 20  # a first chunk fits in any case
    assert ends_with_a_whole_record(path)


def test_recording_ends_with_a_proper_log_before_the_disk_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    failed: Queue[BaseException] = Queue()
    log = McapLog(tmp_path / "session.mcap", header(), min_free_mb=100)
    recorder = Recorder(log, MonotonicClock(), lambda _, why: failed.put(why))
    monkeypatch.setattr(mcap_log, "free_mb", lambda directory: 9.0)
    recorder.record(tick(0))
    recorder.start()
    failure = failed.get(timeout=20)
    recorder.close()
    assert "only 9 MB are free" in str(failure)
    log = read_log(tmp_path / "session.mcap")
    assert not log.truncated
    assert len(log.ticks) == 1


def test_too_little_space_a_missing_folder_or_a_log_that_exists_is_refused(tmp_path: Path) -> None:
    with pytest.raises(LogError, match=r"only .* MB are free.* recording\.min_free_mb$"):
        McapLog(tmp_path / "session.mcap", header(), min_free_mb=1e9)
    assert not (tmp_path / "session.mcap").exists()
    with pytest.raises(LogError, match=r"no: the log folder cannot be used: .*another$"):
        McapLog(tmp_path / "no" / "session.mcap", header())
    (tmp_path / "session.mcap").touch()
    with pytest.raises(LogError, match=r"session\.mcap: the log cannot be created: .*folder$"):
        McapLog(tmp_path / "session.mcap", header())


def test_recording_never_blocks_and_counts_what_it_drops(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(journal, "CAPACITY", 10)
    recorder = Recorder(McapLog(tmp_path / "session.mcap", header()), MonotonicClock(), never_fails)
    for number in range(25):
        recorder.record(tick(number))  # the writer has not started
    assert recorder.dropped == 15
    recorder.start()
    recorder.close()
    log = read_log(tmp_path / "session.mcap")
    assert [record.link.sent for record in log.ticks] == list(range(10))
    assert [one.records for one in log.lost] == [15]


def test_a_recorder_that_never_started_leaves_its_header(tmp_path: Path) -> None:
    recorder = Recorder(McapLog(tmp_path / "session.mcap", header()), MonotonicClock(), never_fails)
    recorder.close()
    recorder.close()
    assert read_log(tmp_path / "session.mcap").header.seed == 7


def _text(path: Path) -> None:
    path.write_text("bitrates, but not a log")


def _reference(path: Path) -> None:
    recorder = ReferenceRecorder(path, 0, 0, never_fails)
    recorder.close()


@pytest.mark.parametrize("make", [_text, Path.touch, _reference, lambda path: None])
def test_a_file_that_is_not_ours_is_told_in_one_sentence(
    tmp_path: Path, make: Callable[[Path], None]
) -> None:
    make(tmp_path / "other.mcap")
    with pytest.raises(LogError) as caught:
        read_log(tmp_path / "other.mcap")
    assert "other.mcap" in str(caught.value)
    assert "\n" not in str(caught.value)
    assert not str(caught.value).endswith(".")


@pytest.mark.parametrize("foreign", [b"{}", b"[]", b"3", b'{"weights": 5}'])
def test_a_foreign_header_is_told_without_the_inside_of_python(
    tmp_path: Path, foreign: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(HEADER, "encode", lambda record: foreign)
    record_all(tmp_path / "session.mcap", [])
    with pytest.raises(LogError, match=r"/header is not as TAMS .* writes it") as caught:
        read_log(tmp_path / "session.mcap")
    assert "__init__" not in str(caught.value)


@pytest.mark.parametrize(("schema", "other"), [(99, "a newer"), (3, "an older")])
def test_a_log_of_another_form_names_the_version_that_wrote_it(
    tmp_path: Path, schema: int, other: str
) -> None:
    record_all(tmp_path / "session.mcap", [], schema=schema, version="9.9.9")
    with pytest.raises(LogError, match=rf"by {other} TAMS \(9\.9\.9, logs of schema {schema}\)"):
        read_log(tmp_path / "session.mcap")


def test_the_newest_time_of_any_record_ends_the_log(tmp_path: Path) -> None:
    record_all(tmp_path / "session.mcap", [Note(START_NS + 9 * NS_PER_S, "info", ""), tick(0)])
    assert read_log(tmp_path / "session.mcap").ended_ns == START_NS + 9 * NS_PER_S


def test_reference_captures_are_lossless(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    frames = [
        Frame(view, index, START_NS + index, random.integers(0, 256, (48, 64, 3), np.uint8))
        for index in (0, 1, 3)
        for view in ("eih", "gt")
    ]
    offset_ns = header().wall_offset_ns
    recorder = ReferenceRecorder(tmp_path / "reference.mcap", offset_ns, 0, never_fails)
    recorder.start()
    for frame in frames:
        recorder.record(frame)
    recorder.close()
    read = list(read_reference(tmp_path / "reference.mcap", offset_ns))
    assert [(one.view, one.index, one.capture_ns) for one in read] == [
        (one.view, one.index, one.capture_ns) for one in frames
    ]
    for written, back in zip(frames, read, strict=True):
        np.testing.assert_array_equal(written.image, back.image)


def test_a_full_disk_ends_the_reference_but_keeps_whole_frames(tmp_path: Path) -> None:
    random = np.random.default_rng(0)
    image = random.integers(0, 256, (100, 100, 3), np.uint8)  # 30 kB that do not shrink
    failed: Queue[BaseException] = Queue()
    path = tmp_path / "reference.mcap"
    with file_size_limit(200_000):
        recorder = ReferenceRecorder(path, 0, 0, lambda _, why: failed.put(why))
        for index in range(20):
            recorder.record(Frame("eih", index, index, image))
        recorder.start()
        failure = failed.get(timeout=20)
        recorder.close()
    assert isinstance(failure, LogError)
    read = list(read_reference(path, 0))
    assert [frame.index for frame in read] == list(range(len(read)))
    assert len(read) == 6
    assert ends_with_a_whole_record(path)


def test_a_short_write_is_completed(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = mcap_log.LogFile(tmp_path / "file")
    inner = file._file  # which takes at most three bytes at a time here
    slow = SimpleNamespace(write=lambda data: inner.write(data[:3]), close=inner.close)
    monkeypatch.setattr(file, "_file", slow)
    assert file.write(b"0123456789") == 10
    file.close()
    assert (tmp_path / "file").read_bytes() == b"0123456789"


def test_gaps_that_lie_over_one_another_are_named_as_one() -> None:
    missing = [(30.6, 33.0), (31.4, 33.9), (None, 2.0), (40.0, 41.0)]
    assert "recorded at 0.0 to 2.0 s, 30.6 to 33.9 s, 40.0 to 41.0 s is" in damage_sentence(missing)
