"""The core of the matrix for two computers: a cut, a burst and a second operator, in one session.

More of it is in test_link_network.py and test_link_processes.py.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import pytest

from tams_app.config import load_config
from tams_app.errors import TamsError
from tams_app.recording import SessionLog
from tams_app.teleop.safety import ArmingState, Reason
from tams_app.units import NS_PER_S
from tests.faults.link_log import commanded_mm, outage, travelled_mm
from tests.faults.two_sides import HOST, HandSide, RobotSide
from tests.impaired_link import Conditions, ImpairedLink
from tests.real_time import require_real_time

pytestmark = [
    pytest.mark.timed,
    pytest.mark.matrix,
    pytest.mark.second_chance(standstill_ms=30),  # the arm must reply in 40 ms
    pytest.mark.timeout(200),
]

LOST_AFTER_MS = load_config().link.lost_after_ms
REST_MS = 100.0  # from full speed, measured by benchmarks/link
SLACK_MS = 100.0  # beside other programs
STILL_MM = 1.0  # settling of the arm's own servo
CUT_S, HELD_S = 0.5, 2.0


@dataclass(frozen=True, slots=True)
class Told:
    """What the session came to, and when what happened."""

    log: SessionLog
    cut_ns: int
    held_ns: int
    let_go_ns: int
    after_burst: str  # what the robot's side told then: the arm's state
    busy: str  # how the second operator failed
    second_said: list[str]
    notes: list[str]  # sentences for the operator from the cut until the arm moved again


@pytest.fixture(scope="module")
def told(tmp_path_factory: pytest.TempPathFactory, turn: int) -> Told:
    require_real_time()
    folder = tmp_path_factory.mktemp("link")
    way = Conditions(latency_ms=20.0, jitter_ms=5.0)
    with RobotSide(folder / "robot", video={"fps": 5}) as robot:  # two operators share a processor
        robot.waits()
        with (
            ImpairedLink((HOST, robot.port), way, way) as link,
            HandSide(folder / "operator", link.port) as side,
        ):
            side.moves()
            second = HandSide(folder / "second", robot.port, seconds=6.0)
            with pytest.raises(TamsError) as busy, second:
                pass
            before_cut = len(side.notes)  # the robot's first sentence is that there is no link
            cut_ns = side.loses_the_link(
                lambda: link.passage("cut", "cut"), lambda: link.passage("open", "open"), CUT_S
            )
            side.moves()
            notes = side.notes[before_cut:]
            held_ns = link.passage("hold", "hold")
            time.sleep(HELD_S)
            let_go_ns = link.passage("open", "open")
            time.sleep(0.5)  # the trigger is pressed and the hand moves on
            after = side.arming
            side.engages()
            before_end = len(robot.lines)
        robot.says("fault, operator left", before_end)
        log = robot.interrupted()
    return Told(log, cut_ns, held_ns, let_go_ns, after, str(busy.value), second.said, notes)


@pytest.mark.verify
def test_an_arm_whose_link_is_cut_stops_for_that_reason_and_rests_in_time(told: Told):
    found = outage(told.log, told.cut_ns)
    assert found.speed_mm_s > 150.0
    assert found.reason == Reason.LINK_GAP.label
    assert found.rest_after_ms(LOST_AFTER_MS) < REST_MS + SLACK_MS
    assert any(stop.reason == Reason.LINK_GAP.label for stop in told.log.stops)


def test_the_operator_is_notified_of_the_gap_and_what_to_do(told: Told):
    assert any(note.startswith("holding, link gap") for note in told.notes)


def test_samples_kept_back_for_two_seconds_move_nothing_when_they_come_at_once(told: Told):
    found = outage(told.log, told.held_ns)
    assert found.zero_ns < told.let_go_ns
    assert commanded_mm(told.log, told.let_go_ns)[0] == 0.0
    assert travelled_mm(told.log, told.let_go_ns) < STILL_MM
    late = [
        one.refusal
        for one in told.log.hands_received
        if told.held_ns < one.sent_ns < told.let_go_ns - NS_PER_S and one.t_ns > told.let_go_ns
    ]
    assert len(late) > 50
    assert set(late) <= {"too old", "unanswered"}


def test_the_arm_does_not_go_on_by_itself_when_the_link_is_back(told: Told):
    assert told.after_burst == ArmingState.HOLDING


def test_a_release_and_a_press_move_it_again(told: Told):
    after = {tick.arming for tick in told.log.ticks if tick.started_ns > told.let_go_ns}
    assert {ArmingState.READY, ArmingState.ENGAGED} <= after


def test_an_operator_who_leaves_leaves_the_arm_stopped(told: Told):
    last = told.log.ticks[-1]
    assert last.arming == ArmingState.FAULT
    assert last.reason.startswith(Reason.OPERATOR_LEFT.label)


def test_a_second_operator_is_told_that_there_is_one_and_drives_nothing(told: Told):
    assert any("another operator is connected" in sentence for sentence in told.second_said)
    assert told.busy.startswith("another operator was connected")
    assert len({one.operator for one in told.log.hands_received}) == 1  # who also drove afterwards
