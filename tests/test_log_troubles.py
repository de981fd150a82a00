"""What becomes of a log whose disk hangs or whose viewers fail."""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Any
from unittest.mock import Mock

import pytest

from tams_app.recording import Recorder, read_log
from tams_app.recording.mcap_log import McapLog
from tams_app.recording.writer import CAPACITY, HANGS_NS, LOST
from tams_app.runtime.clock import VirtualClock
from tests.synthetic_session import header, never_fails, tick

pytestmark = pytest.mark.waiting


def test_a_disk_that_hangs_is_told_at_once_and_what_it_cost_is_counted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    clock, hangs, goes_on = VirtualClock(), threading.Event(), threading.Event()
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
    for number in range(CAPACITY + 5):
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
