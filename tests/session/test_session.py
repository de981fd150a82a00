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
from tams_app.session.session import Outset, Session
from tests.session.exchange import MemoryJournal

pytestmark = pytest.mark.waiting


@pytest.fixture
def signals() -> Signals:
    return Signals()


@pytest.fixture
def outset(tmp_path: Path, signals: Signals) -> Outset:
    config = load_config(None, {"control.realtime_priority": 0, "recording.ros2": 0})
    return Outset(config, VirtualClock(), tmp_path, signals)


def test_a_failure_stops_the_arm_before_it_is_told(outset: Outset, signals: Signals) -> None:
    order: list[str] = []
    outset.log = MemoryJournal(VirtualClock(), order.append)
    signals.stop_with(lambda: order.append("stop"))
    outset.fail("the relay has ended")
    outset.fail("so has the log")
    assert order == ["stop", "the relay has ended", "stop"]
    assert outset.failure == "the relay has ended"
    assert outset.ended.is_set()


def test_a_log_that_lacks_records_fails_what_is_to_be_evaluated(outset: Outset) -> None:
    outset.require_whole_log()
    assert outset.failure == ""
    outset.records_lost = 22_780
    outset.require_whole_log()
    assert outset.failure == "22780 records are missing from the log; record it again"


def test_an_emergency_stop_in_ros_2_is_one_of_the_session(
    outset: Outset, signals: Signals, monkeypatch: pytest.MonkeyPatch
) -> None:
    given: list[Any] = []

    def recorders(*arguments: Any) -> None:
        given.extend(arguments)
        raise TamsError("the test has what it needs")

    monkeypatch.setattr("tams_app.session.session.live_records", recorders)
    with pytest.raises(TamsError, match="has what it needs"), run(outset):
        pass
    given[-1].estop()
    pending = signals.take(0)
    assert (pending.estop, pending.confirm, pending.faults) == (True, False, ())


class Ended:
    """What runs here: its arm does not acknowledge the stop."""

    def __init__(self) -> None:
        self.finished: list[tuple[str, bool]] = []

    def stop_arm(self, failed: bool) -> None:
        raise TamsError("the arm did not acknowledge the stop")

    def finish(self, reason: str, failed: bool) -> None:
        self.finished.append((reason, failed))


def test_the_other_side_is_told_of_the_end_also_where_stopping_the_arm_fails(
    outset: Outset,
) -> None:
    ended, log = Ended(), SimpleNamespace()

    def ends() -> None:
        with (
            outset.starting() as parts,
            Session(outset, parts, log, ended) as session,  # type: ignore[arg-type]
        ):
            session.end("the trial is over")

    with pytest.raises(TamsError, match="did not acknowledge"):
        ends()
    assert ended.finished == [("the trial is over", False)]


def test_a_session_ends_as_failed_also_where_the_stop_of_its_arm_raises(
    outset: Outset, signals: Signals
) -> None:
    def refuse() -> None:
        raise OSError("no answer")

    signals.stop_with(refuse)
    with pytest.raises(OSError, match="no answer"):
        outset.fail("a part failed")
    assert (outset.failure, outset.ended.is_set()) == ("a part failed", True)


def test_what_fails_at_the_end_is_kept_and_hides_neither_the_first_failure_nor_an_error(
    outset: Outset,
) -> None:
    def fail(text: str) -> None:
        raise TamsError(text)

    def starts(*, and_fails: bool) -> None:
        with outset.starting() as parts:
            parts.stack.callback(fail, "the log cannot be closed")
            if and_fails:
                fail("there is no arm")

    starts(and_fails=False)
    assert outset.failure == "the log cannot be closed"
    outset.failure = ""
    with pytest.raises(TamsError, match="there is no arm"):
        starts(and_fails=True)
    assert outset.failure == "the log cannot be closed"
