"""The recorders: a disk that hangs or fills up, viewers that fail, live and in virtual time."""

from __future__ import annotations

import threading
from collections.abc import Iterable
from contextlib import closing
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from tams_app.errors import LogError
from tams_app.recording import Recorder, journal, mcap_log, read_log, read_video
from tams_app.recording.journal import HANGS_NS, LOST, DirectRecorder
from tams_app.recording.mcap_log import McapLog
from tams_app.runtime.clock import VirtualClock
from tams_app.units import NS_PER_S
from tests.synthetic_session import START_NS, VIEWS, header, live_records, never_fails, tick
from tests.test_recording import record_all

pytestmark = pytest.mark.waiting


def test_a_disk_that_hangs_is_told_at_once_and_what_it_cost_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, hangs, goes_on = VirtualClock(), threading.Event(), threading.Event()
    monkeypatch.setattr(journal, "CAPACITY", 100)
    log = Recorder(McapLog(tmp_path / "session.mcap", header()), clock, never_fails)
    write = log._log.write

    def hanging(item: Any, now_ns: int) -> None:
        hangs.set()
        assert goes_on.wait(60)
        write(item, now_ns)

    monkeypatch.setattr(log._log, "write", hanging)
    log.start()
    log.record(tick(0))
    assert hangs.wait(60)
    assert log.troubles() == []
    clock.advance_ns(HANGS_NS + 1)
    (sentence,) = log.troubles()
    assert sentence.startswith("the disk of the log does not respond")
    for number in range(100 + 5):
        log.record(tick(number))
    assert log.troubles()[-1] == LOST
    assert log.dropped == 5
    goes_on.set()
    log.close()
    found = read_log(tmp_path / "session.mcap")
    assert [(one.records, one.since_ns) for one in found.lost] == [(5, found.ticks[-1].started_ns)]


@pytest.mark.parametrize("at", ["receive", "close"])
def test_a_viewer_that_fails_or_cannot_be_closed_costs_the_log_nothing(
    tmp_path: Path, at: str
) -> None:
    viewer = Mock(**{f"{at}.side_effect": RuntimeError("a viewer")})
    path = tmp_path / "session.mcap"
    log = Recorder(McapLog(path, header(), viewers=[viewer]), VirtualClock(), never_fails)
    log.start()
    for number in range(10):
        log.record(tick(number))
    log.close()
    log.close()
    found = read_log(path)
    assert (len(found.ticks), found.truncated) == (10, False)
    (sentence,) = log.troubles()
    assert sentence.startswith("viewers are sent nothing more (RuntimeError")


# --- at once, in virtual time ---------------------------------------------------------------------


def write(path: Path, items: Iterable[Any], bitstream: bool = True) -> Path:
    clock = VirtualClock(START_NS)
    with closing(DirectRecorder(McapLog(path, header(), bitstream), clock)) as log:
        for item in items:
            log.record(item)
            clock.advance_ns(NS_PER_S // 1000)
    return path


def test_the_log_of_virtual_time_keeps_what_the_live_recorder_keeps(tmp_path: Path) -> None:
    items = list(live_records(2.0))
    record_all(tmp_path / "live.mcap", items)
    expected = read_log(tmp_path / "live.mcap")
    found = read_log(write(tmp_path / "direct.mcap", items))
    key = lambda packet: (packet.entered_ns, packet.view, packet.sequence)  # noqa: E731
    assert sorted(found.packets, key=key) == sorted(expected.packets, key=key)
    assert len(found.packets) > 0
    for name in ("phases", "allocations", "captured", "sent", "shown", "quality", "stops"):
        assert getattr(found, name) == getattr(expected, name)
    assert [tick.started_ns for tick in found.ticks] == [tick.started_ns for tick in expected.ticks]
    assert not found.truncated


def test_without_the_bitstream_only_the_frames_sizes_stay(tmp_path: Path) -> None:
    path = write(tmp_path / "session.mcap", live_records(2.0), bitstream=False)
    assert all(not list(read_video(path, view)) for view in VIEWS)
    whole = write(tmp_path / "whole.mcap", live_records(2.0))
    assert read_log(path).sent == read_log(whole).sent != []


def test_a_disk_that_fills_up_ends_it_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock = VirtualClock(START_NS)
    item = next(iter(live_records(2.0)))
    file = McapLog(tmp_path / "session.mcap", header(), min_free_mb=100)
    with closing(DirectRecorder(file, clock)) as log:
        monkeypatch.setattr(mcap_log, "free_mb", lambda directory: 9.0)
        clock.advance_ns(2 * NS_PER_S)
        with pytest.raises(LogError, match="only 9 MB are free"):
            log.record(item)
    assert read_log(tmp_path / "session.mcap").header == header()
