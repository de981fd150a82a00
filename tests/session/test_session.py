"""What a session does when a part of it fails."""

from __future__ import annotations

from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from tams_app.config import load_config
from tams_app.errors import TamsError
from tams_app.robot.control import Signals
from tams_app.runtime.clock import VirtualClock
from tams_app.session.run import run
from tams_app.session.session import Session

pytestmark = pytest.mark.waiting


def test_a_failure_stops_the_arm_before_it_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = run(load_config(None), VirtualClock(), tmp_path)
    order: list[str] = []
    log = SimpleNamespace(note=lambda _level, text: order.append(text))
    assert isinstance(session.signals, Signals)
    session.signals.stop_with(lambda: order.append("stop"))
    monkeypatch.setattr(session, "_log", log)
    session.fail("the relay has ended")
    session.fail("so has the log")
    assert order == ["stop", "the relay has ended", "stop"]
    assert session.failure == "the relay has ended"
    assert session.ended.is_set()


def test_a_log_that_lacks_records_fails_what_is_to_be_evaluated(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    session = run(load_config(None), VirtualClock(), tmp_path)
    monkeypatch.setattr(session, "_log", SimpleNamespace(dropped=0))
    session.require_whole_log()
    assert session.failure == ""
    monkeypatch.setattr(session, "_log", SimpleNamespace(dropped=22_780))
    session.require_whole_log()
    assert session.failure == "22780 records are missing from the log; record it again"


def test_an_emergency_stop_in_ros_2_is_one_of_the_session(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[Any] = []

    def recorders(*arguments: Any) -> None:
        given.extend(arguments)
        raise TamsError("the test has what it needs")

    monkeypatch.setattr("tams_app.session.session.live_records", recorders)
    config = load_config(None, {"control.realtime_priority": 0, "recording.ros2": 0})
    session = run(config, VirtualClock(), tmp_path)
    with pytest.raises(TamsError, match="has what it needs"):
        session.start()
    given[-1]()
    assert isinstance(session.signals, Signals)
    pending = session.signals.take(0)
    assert (pending.estop, pending.confirm, pending.faults) == (True, False, ())


class Ended:
    """What runs here: its arm does not acknowledge the stop."""

    station, pids = None, {}

    def __init__(self) -> None:
        self.finished: list[tuple[str, bool]] = []

    def stop_arm(self, failed: bool) -> None:
        raise TamsError("the arm did not acknowledge the stop")

    def finish(self, reason: str, failed: bool) -> None:
        self.finished.append((reason, failed))


def test_the_other_side_is_told_of_the_end_also_where_stopping_the_arm_fails(
    tmp_path: Path,
) -> None:
    config = load_config(None, {"control.realtime_priority": 0})
    ended: Any = Ended()
    session = Session(config, VirtualClock(), tmp_path, Signals(), lambda _session: ended)
    session.start()
    session.end("the trial is over")
    with pytest.raises(TamsError, match="did not acknowledge"):
        session.close()
    assert ended.finished == [("the trial is over", False)]


def test_a_session_ends_as_failed_also_where_the_stop_of_its_arm_raises(tmp_path: Path) -> None:
    def refuse() -> None:
        raise OSError("no answer")

    compose: Any = None  # it is never started
    config, signals = load_config(None, {"control.realtime_priority": 0}), Signals()
    signals.stop_with(refuse)
    session = Session(config, VirtualClock(), tmp_path, signals, compose)
    with pytest.raises(OSError, match="no answer"):
        session.fail("a part failed")
    assert (session.failure, session.ended.is_set()) == ("a part failed", True)
