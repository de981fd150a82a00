"""Each process of a session on two computers killed or stopped while the arm moves."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import ExitStack
from itertools import groupby
from pathlib import Path

import psutil
import pytest

from tams_app.config import load_config
from tams_app.faces.terminal.line import status_words
from tams_app.link.keys import new_key, revoke_key
from tams_app.records import Activity
from tams_app.teleop.safety import ArmingState, Reason
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.faults.applications import until
from tests.faults.link_log import Outage, commanded_mm, outage
from tests.faults.two_sides import HandSide, OperateSide, RobotSide

pytestmark = [
    pytest.mark.timed,
    pytest.mark.matrix,
    pytest.mark.second_chance(standstill_ms=30),  # the arm must reply in 40 ms
    pytest.mark.verify,
    pytest.mark.usefixtures("real_time"),
    pytest.mark.timeout(300),
]

LOST_AFTER_MS = load_config().link.lost_after_ms
REST_MS, SLACK_MS = 100.0, 150.0  # the sample before may be some time old
STOPPED_S = 1.0
STANDS_S = 0.5
REVOKED_WITHIN_MS = 1000.0
SLOWLY = 0.1  # of full speed: within that time the arm comes to no edge of its workspace
LINK_GAP, LINK_LOST = "holding, link gap", "fault, link lost"


@pytest.fixture
def robot(tmp_path: Path) -> Iterator[RobotSide]:
    with RobotSide(tmp_path / "robot") as started:
        started.waits()
        yield started


@pytest.fixture
def side(robot: RobotSide, tmp_path: Path) -> Iterator[HandSide]:
    with ExitStack() as stack:
        one = stack.enter_context(HandSide(tmp_path / "operator", robot.port))
        one.moves()
        yield one


@pytest.fixture
def operate(robot: RobotSide, tmp_path: Path) -> Iterator[OperateSide]:
    """The simulated operator at work, and the arm moving."""
    before = len(robot.lines)
    with OperateSide(tmp_path / "operate", robot.port) as started:
        robot.engaged(before)
        started.note_helpers()
        yield started


def rested_after_ms(found: Outage, from_ns: int) -> float:
    """From then until the arm rested."""
    return (found.rest_ns - from_ns) / NS_PER_MS


def stops(process: psutil.Process) -> int:
    """Stop the process; when [ns]."""
    stopped_ns = time.monotonic_ns()
    process.suspend()
    return stopped_ns


def rests_in_time(robot: RobotSide, from_ns: int, reason: str) -> None:
    """The arm was stopped for `reason` and stood soon after; the robot's log says so. Ends it."""
    time.sleep(STANDS_S)
    log = robot.interrupted()
    found = outage(log, from_ns)
    assert found.reason.startswith(reason)
    assert rested_after_ms(found, from_ns) < LOST_AFTER_MS + REST_MS + SLACK_MS
    assert any(stop.reason.startswith(reason) for stop in log.stops)
    assert commanded_mm(log, found.zero_ns)[0] == 0.0


def fails(side: HandSide) -> str:
    """The sentence with which the operator's side fails."""

    def failed() -> bool:
        side.session.poll()
        return bool(side.outset.failure)

    until(failed, "the operator's side to fail")
    return side.outset.failure


def receives_nothing(side: HandSide) -> bool:
    """Whether the operator's side has told so."""
    side.session.poll()
    return any(note.startswith("nothing is heard of the robot") for note in side.notes)


def test_the_arm_of_a_killed_robots_side_is_stopped_by_the_guard_and_the_operator_is_told(
    robot: RobotSide, side: HandSide
) -> None:
    witness = robot.watched()
    robot.keep_the_rig()
    robot.process.kill()
    witness.waits_for_the_stop()
    witness.stands()
    until(lambda: receives_nothing(side), "the operator's side to tell that nothing is heard")
    robot.let_go()


def test_a_guard_of_the_robot_that_hangs_stops_the_arm_until_it_answers_and_the_operator_reads_why(
    robot: RobotSide, side: HandSide
) -> None:
    robot.helper("guard").suspend()
    until(lambda: side.reason.startswith(Reason.GUARD_SILENT.label), "the reason to be told")
    assert side.arming == ArmingState.FAULT
    robot.watched().stands()
    robot.helper("guard").resume()
    side.moves()


def test_a_killed_gateway_of_the_robot_ends_its_session_and_the_operator_hears_nothing(
    robot: RobotSide, side: HandSide
) -> None:
    killed_ns = time.monotonic_ns()
    robot.helper("link").kill()
    code, words = robot.ends()
    assert code == 1
    assert "the helper process link ended unasked" in words

    until(lambda: receives_nothing(side), "the operator's side to tell that nothing is heard")
    log = robot.recorded()
    fault = next(
        one for one in log.ticks if one.started_ns > killed_ns and one.arming == ArmingState.FAULT
    )
    assert fault.reason.startswith((Reason.LINK_LOST.label, Reason.SESSION_FAILED.label))
    late_ms = (fault.started_ns - killed_ns) / NS_PER_MS
    assert late_ms < LOST_AFTER_MS + SLACK_MS
    assert commanded_mm(log, fault.started_ns)[0] == 0.0
    last = log.ticks[-1].arm
    assert last is not None
    assert last.activity is Activity.STOPPED


def test_a_stopped_gateway_of_the_robot_stops_the_arm_and_what_waited_in_it_moves_nothing(
    robot: RobotSide, side: HandSide
) -> None:
    gateway = robot.helper("link")
    stopped_ns = side.loses_the_link(lambda: stops(gateway), gateway.resume, STOPPED_S)
    side.moves()
    log = robot.interrupted()
    found = outage(log, stopped_ns)
    assert found.reason == Reason.LINK_GAP.label
    assert found.zero_ns < stopped_ns + STOPPED_S * NS_PER_S, "before what waited in it came"
    assert commanded_mm(log, found.zero_ns)[0] == 0.0


def test_a_killed_gateway_of_the_operator_stops_the_arm_and_ends_their_session(
    robot: RobotSide, side: HandSide
) -> None:
    before = len(robot.lines)
    killed_ns = time.monotonic_ns()
    side.helper("link").kill()
    robot.says(LINK_LOST, before)
    assert "the helper process link ended unasked" in fails(side)
    rests_in_time(robot, killed_ns, Reason.LINK_GAP.label)


def test_a_stopped_gateway_of_the_operator_stops_the_arm_and_it_is_armed_again_when_it_goes_on(
    robot: RobotSide, side: HandSide
) -> None:
    gateway = side.helper("link")
    stopped_ns = side.loses_the_link(lambda: stops(gateway), gateway.resume, STOPPED_S)
    side.moves()
    rests_in_time(robot, stopped_ns, Reason.LINK_GAP.label)


@pytest.mark.parametrize(
    ("killed", "reason", "fault"),
    [
        (("application",), Reason.OPERATOR_LEFT, Reason.OPERATOR_LEFT),
        (("link", "application"), Reason.LINK_GAP, Reason.LINK_LOST),
    ],
)
def test_a_killed_operators_side_stops_the_arm_and_one_that_is_started_anew_moves_it(
    robot: RobotSide,
    operate: OperateSide,
    tmp_path: Path,
    killed: tuple[str, ...],
    reason: Reason,
    fault: Reason,
) -> None:
    """A gateway whose application has gone says goodbye; a computer without power does not."""
    before = len(robot.lines)
    processes = {"link": operate.helper("link"), "application": operate.process}
    killed_ns = time.monotonic_ns()
    for name in killed:
        processes[name].kill()
    robot.says(f"fault, {fault.label}", before)
    with HandSide(tmp_path / "anew", robot.port) as anew:
        anew.moves()
    rests_in_time(robot, killed_ns, reason.label)


def test_a_stopped_application_of_the_robot_is_stopped_by_the_guard_and_waits_when_it_goes_on(
    robot: RobotSide, side: HandSide
) -> None:
    witness = robot.watched()
    application = psutil.Process(robot.process.pid)
    assert witness.moves()
    application.suspend()
    witness.waits_for_the_stop()
    witness.stands()
    shown = status_words(side.session.state())
    assert "NOT LIVE for" in shown.live
    resumed_ns = time.monotonic_ns()
    application.resume()
    side.becomes(ArmingState.FAULT)
    witness.stands()
    side.moves()
    log = robot.interrupted()
    assert commanded_mm(log, resumed_ns)[0] == 0.0
    fault = next(
        one for one in log.ticks if one.started_ns > resumed_ns and one.arming == ArmingState.FAULT
    )
    assert fault.reason.startswith((Reason.GUARD_STOPPED.label, Reason.LINK_LOST.label))


def test_a_stopped_operators_application_stops_the_arm_which_waits_for_two_confirmations(
    robot: RobotSide, operate: OperateSide
) -> None:
    """The simulated operator gives them, as a person would who reads that the link was away."""
    before = len(robot.lines)
    stopped_ns = time.monotonic_ns()
    application = psutil.Process(operate.process.pid)
    application.suspend()
    robot.says(LINK_GAP, before)
    robot.says(LINK_LOST, before)
    resumed, resumed_ns = len(robot.lines), time.monotonic_ns()
    application.resume()
    robot.engaged(resumed)
    log = robot.interrupted()
    found = outage(log, stopped_ns)
    assert found.reason == Reason.LINK_GAP.label
    assert rested_after_ms(found, stopped_ns) < LOST_AFTER_MS + REST_MS + SLACK_MS
    heard = [one for one in log.hands_received if one.t_ns > resumed_ns and not one.refusal]
    assert len(heard) > 50
    assert commanded_mm(log, found.zero_ns)[0] == 0.0
    after = [tick.arming for tick in log.ticks if tick.started_ns > resumed_ns]
    states = [state for state, _ in groupby(after)]
    assert states[:4] == ["fault", "disarmed", "ready", "engaged"]


def test_a_killed_simulated_operator_ends_their_session_and_stops_the_arm(
    robot: RobotSide, operate: OperateSide
) -> None:
    before = len(robot.lines)
    killed_ns = time.monotonic_ns()
    operate.helper("operator").kill()
    code, words = operate.ends()
    assert code == 1
    assert "operator" in words
    robot.says("fault", before)
    time.sleep(STANDS_S)
    log = robot.interrupted()
    found = outage(log, killed_ns)
    gone = (Reason.RUNTIME_QUIT, Reason.CONTROLLER_DISCONNECTED, Reason.OPERATOR_LEFT)
    assert found.reason in {reason.label for reason in gone}
    assert commanded_mm(log, found.zero_ns)[0] == 0.0


def test_a_stopped_simulated_operator_is_a_frozen_pose(
    robot: RobotSide, operate: OperateSide
) -> None:
    witness = robot.witness
    assert witness is not None
    before = len(robot.lines)
    operate.helper("operator").suspend()
    stopped = robot.says_within(2.0, "fault, pose frozen", before)
    operate.helper("operator").resume()
    assert stopped, robot.lines
    witness.waits_for_the_stop()
    log = robot.interrupted()
    assert any(stop.reason == Reason.POSE_FROZEN.label for stop in log.stops)


def test_an_operator_whose_key_is_revoked_while_the_arm_moves_is_let_go_and_the_arm_stops(
    tmp_path: Path,
) -> None:
    keys = tmp_path / "keys"
    keys.mkdir()
    key = new_key(keys, "kim")
    with RobotSide(tmp_path / "robot", key=keys) as robot:
        robot.waits()
        with HandSide(tmp_path / "operator", robot.port, key) as side:
            side.moves()
            side.hand.velocity *= SLOWLY
            before = len(robot.lines)
            revoked_ns = time.monotonic_ns()
            revoke_key(keys, "kim")
            robot.says(LINK_LOST, before)
            until(
                lambda: receives_nothing(side), "the operator's side to tell that nothing is heard"
            )
            assert "LINK LOST, NOT LIVE" in status_words(side.session.state()).live
        time.sleep(STANDS_S)
        log = robot.interrupted()
    found = outage(log, revoked_ns)
    assert found.reason == Reason.LINK_LOST.label
    assert found.speed_mm_s > 10.0
    assert rested_after_ms(found, revoked_ns) < REVOKED_WITHIN_MS + REST_MS + SLACK_MS
    assert "the key of kim was revoked: its operator is let go" in {note.text for note in log.notes}
    assert commanded_mm(log, found.zero_ns)[0] == 0.0
