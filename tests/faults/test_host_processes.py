"""Processes stopped and killed while the arm moves, each seen from outside by the arm itself.

That every other helper killed ends the session is in tests/test_cut_short.py.
"""

from __future__ import annotations

import resource
import signal
import time
from collections.abc import Iterator
from itertools import groupby
from pathlib import Path

import psutil
import pytest

from hw.lite6.protocol import State
from tams_app.recording import SessionLog
from tams_app.records import Tick
from tams_app.teleop.safety import ArmingState, Reason
from tests.faults.applications import Application, Witness, only_log, until
from tests.faults.braking import TICKS_TO_REST

STOPPED_S = 2.0  # a frame is too old after one
HELD_S = 0.5  # longer than it takes to come to rest

pytestmark = [
    pytest.mark.timed,
    pytest.mark.matrix,
    pytest.mark.second_chance(standstill_ms=30),  # the arm must reply in 40 ms
    pytest.mark.verify,
    pytest.mark.usefixtures("real_time"),
    pytest.mark.timeout(300),
]


@pytest.fixture
def application(tmp_path: Path) -> Iterator[Application]:
    with Application(tmp_path) as started:
        yield started


@pytest.fixture
def witness(application: Application) -> Witness:
    return application.engaged()


def stays_in_fault(log: SessionLog) -> str:
    """From the first fault on nothing is commanded to move, and nothing goes on; its reason."""
    first = next(n for n, tick in enumerate(log.ticks) if tick.arming == ArmingState.FAULT)
    assert all(tick.twist.is_zero for tick in log.ticks[first:])
    assert all(tick.arming == ArmingState.FAULT for tick in log.ticks[first:])
    return log.ticks[first].reason.split(":")[0]


def came_to_rest(log: SessionLog, reason: str) -> bool:
    """Whether in each hold for `reason` that outlasts the stop time the commands stay zero then.

    At least one does.
    """

    def holds(tick: Tick) -> bool:
        return tick.arming == ArmingState.HOLDING and tick.reason.startswith(reason)

    later = []
    for held in (list(ticks) for holding, ticks in groupby(log.ticks, holds) if holding):
        stop_ns = held[0].started_ns + (TICKS_TO_REST + 1) * 8_333_334
        later += [tick for tick in held if tick.started_ns > stop_ns]
    return bool(later) and all(tick.twist.is_zero for tick in later)


def holds_while_stopped(application: Application, helper: psutil.Process) -> int:
    """Stop `helper` until the arm has held for a while; how many lines there were as it went on.

    The operator has just begun to move: they hold the trigger for longer than this takes.
    """
    before = len(application.lines)
    helper.suspend()
    held = application.says_within(STOPPED_S, "holding, stale video", before)
    time.sleep(HELD_S)
    after = len(application.lines)
    helper.resume()
    assert held, f"the arm did not hold: {application.lines}"
    return after


@pytest.mark.parametrize("name", ["renderer", "relay"])
def test_a_stopped_source_of_frames_holds_the_arm_and_it_goes_on_when_they_are_back(
    application: Application, witness: Witness, name: str
) -> None:
    after = holds_while_stopped(application, application.helper(name))
    application.says("engaged", after)
    log = application.interrupted()
    assert came_to_rest(log, Reason.STALE_VIDEO.label)
    assert any(stop.reason == Reason.STALE_VIDEO.label for stop in log.stops)


def test_a_stopped_arm_is_a_fault_and_does_not_go_on_by_itself(
    application: Application, witness: Witness
) -> None:
    before = len(application.lines)
    rig = application.helper("rig")
    rig.suspend()
    application.says("fault", before)
    rig.resume()
    witness.waits_for_the_stop()
    witness.stands()
    reason = stays_in_fault(application.interrupted())
    assert reason in {Reason.ARM_SILENT.label, Reason.ARM_LINK_LOST.label}


def test_a_stopped_runtime_of_the_controller_is_a_fault_and_does_not_go_on_by_itself(
    application: Application, witness: Witness
) -> None:
    """As a VR runtime that hangs: the last sample grows old."""
    operator = application.helper("operator")
    before = len(application.lines)
    operator.suspend()
    stopped = application.says_within(STOPPED_S, "fault, pose frozen", before)
    operator.resume()
    assert stopped, application.lines
    witness.waits_for_the_stop()
    witness.stands()
    assert stays_in_fault(application.interrupted()) == Reason.POSE_FROZEN.label


def test_an_operator_who_sees_does_nothing_without_video_and_goes_on_with_it(
    tmp_path: Path,
) -> None:
    """They let go, or the arm holds, whichever comes first."""
    with Application(tmp_path, operator="seeing") as application:
        witness = application.engaged()
        relay = application.helper("relay")
        relay.suspend()
        time.sleep(STOPPED_S)  # a pause before the last frame is too old is none for its age
        until(lambda: not witness.moves(), "the arm to come to rest")
        witness.stands(5.0)
        before = len(application.lines)
        relay.resume()
        application.says("engaged", before)
        until(witness.moves, "the arm to move on")
        log = application.interrupted()
    assert log.facts["operator"] == "seeing"
    assert log.glances


def test_a_killed_measurement_of_the_frames_is_told_and_neither_stops_the_arm_nor_the_session(
    tmp_path: Path,
) -> None:
    with Application(tmp_path, quality=True) as application:
        witness = application.engaged()
        kill_the_measurement(application, witness)


def kill_the_measurement(application: Application, witness: Witness) -> None:
    before = len(application.lines)
    application.helper("quality").kill()
    application.says("the frames' quality is not measured", before)
    until(witness.moves, "the arm to move on")
    assert not any(line.startswith("fault") for line in application.lines[before:])
    log = application.interrupted()
    assert log.quality
    (told,) = (note for note in log.notes if "is not measured" in note.text)
    assert told.level == "warning"
    later = [tick for tick in log.ticks if tick.started_ns > told.t_ns]
    assert any(tick.arming == ArmingState.ENGAGED and not tick.twist.is_zero for tick in later)
    assert max(one.shown_ns for one in log.shown) > told.t_ns


def test_a_stopped_application_is_stopped_by_the_guard_and_moves_nothing_when_it_goes_on(
    application: Application, witness: Witness
) -> None:
    before = len(application.lines)
    application.process.send_signal(signal.SIGSTOP)
    witness.waits_for_the_stop()
    witness.stands()
    application.process.send_signal(signal.SIGCONT)
    application.says("fault", before)
    witness.stands(1.0)
    assert witness.state() == State.STOPPED
    # the latter if it was stopped between hearing the guard and looking at the arm
    reasons = {Reason.GUARD_STOPPED.label, Reason.ARM_STOPPED.label}
    assert stays_in_fault(application.interrupted()) in reasons


def ends_armed(log: SessionLog) -> bool:
    return bool(log.ticks) and ArmingState(log.ticks[-1].arming).is_armed


def test_the_arm_of_a_killed_application_is_stopped_by_the_guard(tmp_path: Path) -> None:
    with Application(tmp_path) as application:
        witness = application.engaged()
        application.keep_the_rig()
        # the log goes to the disk each 0.8 s
        until(lambda: ends_armed(only_log(application.out)), "armed ticks on the disk")
        application.process.kill()
        witness.waits_for_the_stop()
        witness.stands()
        guard = application.helper("guard")
        until(lambda: not guard.is_running() or guard.status() == "zombie", "the guard's end")
        assert witness.state() == State.STOPPED
        application.let_go()
        code, _ = application.ends()
        assert code == -signal.SIGKILL
        log = only_log(application.out)
        assert log.truncated
        assert ends_armed(log)


def test_a_full_disk_stops_the_arm_and_leaves_what_was_written_readable(
    application: Application, witness: Witness
) -> None:
    application.keep_the_rig()
    until(lambda: ends_armed(only_log(application.out)), "armed ticks on the disk")
    (folder,) = application.out.iterdir()
    size = (folder / "session.mcap").stat().st_size
    _, most = resource.prlimit(application.process.pid, resource.RLIMIT_FSIZE)
    resource.prlimit(application.process.pid, resource.RLIMIT_FSIZE, (size, most))
    witness.waits_for_the_stop()
    code, words = application.ends()
    assert code == 1
    (sentence,) = words.strip().splitlines()
    assert sentence.startswith("tams: ")
    assert "the log cannot be written any more" in sentence
    log = only_log(application.out)
    assert any(tick.arming == ArmingState.READY for tick in log.ticks)
    assert not any(tick.arming == ArmingState.FAULT for tick in log.ticks)
