"""What a network may do between two computers while the arm moves at full speed.

A cut both ways, a burst and a second operator are in test_link_lost.py.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tams_app.config import load_config
from tams_app.errors import TamsError
from tams_app.link.keys import new_key
from tams_app.recording import SessionLog, read_log
from tams_app.teleop.safety import ArmingState, Reason
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.faults.link_log import Outage, losses, outage
from tests.faults.two_sides import HOST, HandSide, RobotSide
from tests.impaired_link import Conditions, ImpairedLink

pytestmark = [
    pytest.mark.timed,
    pytest.mark.second_chance(standstill_ms=30),  # the arm must reply in 40 ms
    pytest.mark.verify,
    pytest.mark.usefixtures("real_time"),
    pytest.mark.timeout(200),
]

LINK = load_config().link
REST_MS, SLACK_MS = 100.0, 100.0
CUT_S, WHILE_S = 1.6, 2.0  # samples without a new echo count for a second
HOSTILE_HZ = 2000
GAPS_ADVICE = f"a minute exceed link.lost_after_ms ({LINK.lost_after_ms:g} ms) and hold"
# Of the frames: if a late datagram were a lost one, a fifth of them would damage nearly all frames.
# A frame that the machine has encoded too late for the jitter buffer to wait is damaged by one.
MOST_DAMAGED = 0.5
CONNECTED = "an operator is connected, with the key of key"
WAY = Conditions(latency_ms=20.0, jitter_ms=5.0)


class Two:
    """Both sides under one key, and the network between them."""

    def __init__(self, folder: Path, stack: ExitStack) -> None:
        self.folder = folder
        self._went_on_ns: list[tuple[int, int]] = []
        self.key = folder / "key"
        new_key(self.key)
        self.robot = stack.enter_context(RobotSide(folder / "robot", self.key))
        self.robot.waits()
        address = (HOST, self.robot.port)
        self.link = stack.enter_context(ImpairedLink(address, WAY, WAY))
        self.operator = ExitStack()
        stack.enter_context(self.operator)
        side = HandSide(folder / "operator", self.link.port, self.key)
        self.side = self.operator.enter_context(side)

    def goes_on_for(self, seconds: float) -> None:
        """The hand goes to and fro and drives the arm; nothing stops it, see also `log`."""
        from_ns = time.monotonic_ns()
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            time.sleep(0.3)
            self.side.hand.velocity = -self.side.hand.velocity
            assert self.side.arming == ArmingState.ENGAGED, self.side.reason
        self._went_on_ns.append((from_ns, time.monotonic_ns()))

    def damaged(self, from_ns: int) -> float:
        """The share of the frames shown since then that were not whole; 1.0 if none was shown."""
        log = read_log(self.folder / "operator" / "session" / "session.mcap")
        shown = [frame.whole for frame in log.shown if frame.shown_ns > from_ns]
        return shown.count(False) / len(shown) if shown else 1.0

    def log(self) -> SessionLog:
        """The robot's side's, once the operator has left.

        While the hand went on the link was never lost.
        """
        self.operator.close()
        log = self.robot.interrupted()
        lost_ns = [t_ns for went_on in self._went_on_ns for t_ns in losses(log, *went_on)]
        assert lost_ns == []
        return log


@pytest.fixture
def two(tmp_path: Path) -> Iterator[Two]:
    with ExitStack() as stack:
        yield Two(tmp_path, stack)


def lost(two: Two, reasons: set[str], *, there: bool, back: bool) -> tuple[Outage, int]:
    """Cut so while the arm moves, and arm it anew; how it stopped, and when the cut was [ns].

    It stopped for one of `reasons`, and the operator was notified of that.
    """
    two.side.moves()
    before = len(two.side.notes)  # the robot's first sentence is that there is no link
    cut_ns = two.side.loses_the_link(
        lambda: two.link.passage("cut" if there else "open", "cut" if back else "open"),
        lambda: two.link.passage("open", "open"),
        CUT_S,
    )
    two.side.moves()
    starts = tuple(f"holding, {reason}" for reason in reasons)
    assert any(note.startswith(starts) for note in two.side.notes[before:])
    log = two.log()
    found = outage(log, cut_ns)
    assert found.reason in reasons
    assert any(stop.reason == found.reason for stop in log.stops)
    return found, cut_ns


def test_samples_that_no_longer_come_stop_the_arm(two: Two):
    found, _ = lost(two, {Reason.LINK_GAP.label}, there=True, back=False)
    assert found.rest_after_ms(LINK.lost_after_ms) < REST_MS + SLACK_MS


def test_a_session_that_gaps_hold_more_than_three_times_a_minute_says_once_what_to_set(two: Two):
    for _ in range(6):
        two.side.engages()
        before = len(two.side.notes)
        two.link.passage("hold", "hold")
        time.sleep(0.15)  # as while the Wi-Fi of a headset saves power
        two.link.passage("open", "open")
        two.side.becomes(ArmingState.HOLDING)
        assert any(note.startswith("holding, link gap") for note in two.side.notes[before:])
    two.side.arms()
    (advice,) = [note for note in two.side.notes if GAPS_ADVICE in note]
    assert "set link.lost_after_ms to " in advice
    assert advice.endswith("or use a cable"), "not cut"


def test_an_operator_who_no_longer_hears_the_robot_moves_nothing_beyond_the_bound(two: Two):
    """Their samples come, and with them neither a newer echo nor a frame that was shown."""
    reasons = {Reason.LINK_GAP.label, Reason.STALE_VIDEO.label}
    found, cut_ns = lost(two, reasons, there=False, back=True)
    limit_ms = LINK.stopped_after_ms + REST_MS + SLACK_MS
    assert (found.rest_ns - cut_ns) / NS_PER_MS < limit_ms


@pytest.mark.parametrize("kind", ["reorder", "duplicate"])
def test_datagrams_out_of_order_or_twice_disturb_nothing(two: Two, kind: str):
    two.side.moves()
    two.link.there = replace(WAY, **{kind: 0.2})  # type: ignore[arg-type]
    two.link.back = replace(WAY, **{kind: 0.2})  # type: ignore[arg-type]
    from_ns = two.link.tell()
    two.goes_on_for(WHILE_S)
    log = two.log()
    heard = [one for one in log.hands_received if one.t_ns > from_ns]
    assert all(one.refusal == "" for one in heard)
    assert np.all(np.diff([one.sent_ns for one in heard]) > 0)
    assert log.link_health[-1].ignored["late"] > 10
    assert two.damaged(from_ns) < MOST_DAMAGED


def test_an_operator_whose_address_changes_goes_on(two: Two):
    two.side.moves()
    for _ in range(5):
        two.link.move()
        two.goes_on_for(0.4)
    log = two.log()
    assert sum(note.text == CONNECTED for note in log.notes) == 1


def test_a_session_played_again_from_elsewhere_changes_nothing(two: Two):
    two.side.moves()
    two.link.replay()
    two.goes_on_for(1.0)
    two.operator.close()
    time.sleep(1.0)
    silent_ns = time.monotonic_ns()
    two.link.replay()  # now there is no operator: nothing makes one of it
    time.sleep(4.0)  # also when who was there has let go
    two.link.replay()
    time.sleep(1.0)
    log = two.log()
    after = [tick for tick in log.ticks if tick.started_ns > silent_ns]
    assert {tick.arming for tick in after} == {ArmingState.FAULT}
    assert all(tick.twist.is_zero for tick in after)
    assert [one for one in log.hands_received if one.t_ns > silent_ns] == []
    assert sum(note.text == CONNECTED for note in log.notes) == 1


def test_hostile_datagrams_at_both_ports_do_not_disturb_an_arm_that_moves(two: Two):
    two.side.moves()
    two.link.attack(HOSTILE_HZ)
    two.goes_on_for(10.0)
    two.link.attack(0)
    log = two.log()
    assert two.link.hostile > 15_000
    assert sum(log.link_health[-1].ignored.values()) > two.link.hostile / 2
    assert sum(note.text == CONNECTED for note in log.notes) == 1
    stray = [one.operator for one in log.hands_received]
    assert len(set(stray)) == 1


def test_an_operator_with_another_key_gets_no_answer_and_the_one_who_is_there_goes_on(two: Two):
    other = two.folder / "other-key"
    new_key(other)

    def calls() -> None:
        with HandSide(two.folder / "other", two.robot.port, other, seconds=5.0):
            pass

    two.side.moves()
    with ThreadPoolExecutor(1) as beside:
        called = beside.submit(calls)
        while not called.done():
            two.goes_on_for(0.6)
    with pytest.raises(TamsError, match="no answer"):
        called.result()
    log = two.log()
    assert log.link_health[-1].ignored["calls that no key made"] >= 1
    assert len({one.operator for one in log.hands_received}) == 1
    assert sum(note.text == CONNECTED for note in log.notes) == 1


def test_a_link_that_was_away_for_long_comes_back_and_the_arm_waits_for_a_confirmation(two: Two):
    """Longer than the robot's side holds its place for a silent operator."""
    two.side.moves()
    two.link.passage("cut", "cut")
    time.sleep(5.0)
    back_ns = two.link.passage("open", "open")
    two.side.becomes(ArmingState.FAULT)
    time.sleep(1.0)
    assert two.side.arming == ArmingState.FAULT
    confirmed_ns = time.monotonic_ns()
    two.side.moves()
    log = two.log()
    between = [tick for tick in log.ticks if back_ns < tick.started_ns < confirmed_ns]
    assert between[-1].started_ns - between[0].started_ns > 0.8 * NS_PER_S
    assert {tick.arming for tick in between} == {ArmingState.FAULT}
