"""The log of virtual time: what the live recorder keeps, at once."""

from __future__ import annotations

from contextlib import closing

import pytest

from tams_app.errors import LogError
from tams_app.recording import Recorder, disk, read_log, read_video
from tams_app.recording.mcap_log import McapLog
from tams_app.recording.writer import DirectRecorder
from tams_app.runtime.clock import MonotonicClock, VirtualClock
from tams_app.units import NS_PER_S
from tests.synthetic_session import START_NS, VIEWS, header, live_records, never_fails

pytestmark = pytest.mark.waiting


def write(path, items, bitstream=True):
    clock = VirtualClock(START_NS)
    with closing(DirectRecorder(McapLog(path, header(), bitstream), clock)) as log:
        for item in items:
            log.record(item)
            clock.advance_ns(NS_PER_S // 1000)
    return path


def test_it_keeps_what_the_live_recorder_keeps(tmp_path):
    items = list(live_records(2.0))
    live = Recorder(McapLog(tmp_path / "live.mcap", header()), MonotonicClock(), never_fails)
    live.start()
    for item in items:
        live.record(item)
    live.close()
    expected = read_log(tmp_path / "live.mcap")
    found = read_log(write(tmp_path / "direct.mcap", items))
    key = lambda packet: (packet.entered_ns, packet.view, packet.sequence)  # noqa: E731
    assert sorted(found.packets, key=key) == sorted(expected.packets, key=key)
    assert len(found.packets) > 0
    for name in ("phases", "allocations", "captured", "sent", "shown", "quality", "stops"):
        assert getattr(found, name) == getattr(expected, name)
    assert [tick.started_ns for tick in found.ticks] == [tick.started_ns for tick in expected.ticks]
    assert not found.truncated


def test_without_the_bitstream_only_the_frames_sizes_stay(tmp_path):
    path = write(tmp_path / "session.mcap", live_records(2.0), bitstream=False)
    assert all(not list(read_video(path, view)) for view in VIEWS)
    whole = write(tmp_path / "whole.mcap", live_records(2.0))
    assert read_log(path).sent == read_log(whole).sent != []


def test_a_disk_that_fills_up_ends_it_in_one_sentence(tmp_path, monkeypatch):
    clock = VirtualClock(START_NS)
    item = next(iter(live_records(2.0)))
    file = McapLog(tmp_path / "session.mcap", header(), min_free_mb=100)
    with closing(DirectRecorder(file, clock)) as log:
        monkeypatch.setattr(disk, "free_mb", lambda directory: 9.0)
        clock.advance_ns(2 * NS_PER_S)
        with pytest.raises(LogError, match="only 9 MB are free"):
            log.record(item)
    assert read_log(tmp_path / "session.mcap").header == header()
