"""The guard stops an arm whose control loop is silent; the loop stops an arm without a guard.

The guard is the real process, against the controller on TCP, beside the real driver.
"""

from __future__ import annotations

import os
import signal
import threading
from pathlib import Path

import pytest

from tams_app.robot.guarding import SILENCE_NS
from tams_app.teleop.records import Refusal, TeleopOutput
from tams_app.teleop.safety import ArmingState, Reason
from tests.faults.bench import PERIOD_NS
from tests.faults.promises import (
    is_logged,
    is_stopped,
    recovers_from_fault,
    stands,
)
from tests.faults.wired_bench import SIDEWAYS, MakeBench, WiredBench

# The guard is silent after 200 ms; the machine may stand still in several parts.
pytestmark = [pytest.mark.timed, pytest.mark.second_chance(standstill_ms=60)]

KILLED_TICKS = 2  # the first beat is refused, the next tick hears of it
STOPPED_TICKS = SILENCE_NS // PERIOD_NS + 2


def guard_pid(bench: WiredBench) -> int:
    assert bench.guarding is not None
    pid = bench.guarding.process.pid
    assert pid is not None
    return pid


@pytest.fixture
def guarded(tmp_path: Path, make_bench: MakeBench) -> WiredBench:
    bench = make_bench(tmp_path)
    bench.add_guard()
    return bench


def test_a_killed_guard_stops_the_arm(guarded: WiredBench) -> None:
    guarded.engage_and_move()
    os.kill(guard_pid(guarded), signal.SIGKILL)
    assert guarded.guarding is not None
    process = guarded.guarding.process
    guarded.until(lambda: process.exit_code is not None)
    since = guarded.next
    seen = guarded.run_until_state(ArmingState.FAULT)
    assert seen - since < KILLED_TICKS
    is_stopped(guarded, seen, Reason.GUARD_LOST)
    stays(guarded)
    is_logged(guarded, Reason.GUARD_LOST)


def test_a_guard_that_hangs_stops_the_arm_which_may_go_on_once_it_answers(
    guarded: WiredBench,
) -> None:
    guarded.engage_and_move()
    os.kill(guard_pid(guarded), signal.SIGSTOP)
    try:
        since = guarded.next
        seen = guarded.run_until_state(ArmingState.FAULT)
        assert seen - since <= STOPPED_TICKS
        is_stopped(guarded, seen, Reason.GUARD_SILENT)
        tells(guarded, Reason.GUARD_SILENT)
    finally:
        os.kill(guard_pid(guarded), signal.SIGCONT)
    tells(guarded, None)
    recovers_from_fault(guarded)
    is_logged(guarded, Reason.GUARD_SILENT)


def stays(bench: WiredBench) -> None:
    """The sentence asks for a new session: nothing else ends this fault."""
    assert "start the session again" in Reason.GUARD_LOST.lasting
    bench.hand.trigger = 0.0
    bench.run_ticks(3)
    bench.signals.confirm(bench.clock.now_ns())
    stands(bench, 30)
    assert bench.outputs[-1].arming is ArmingState.FAULT


# --- the guard cannot reach the arm --------------------------------------------------------------


def tells(bench: WiredBench, in_the_way: Reason | None) -> None:
    """Confirm in each tick, the trigger held, until the operator is told of that; None: of it."""

    def told(output: TeleopOutput) -> bool:
        bench.signals.confirm(bench.clock.now_ns())
        return output.refusal == Refusal(in_the_way)

    bench.run_until(told)
    bench.run_ticks(2)
    assert bench.outputs[-1].arming is ArmingState.FAULT


def test_a_controller_that_restarts_is_armed_again_once_the_guard_has_found_it(
    guarded: WiredBench,
) -> None:
    guarded.engage_and_move()
    guarded.quiesce()
    guarded.reachable = False
    guarded.server.refuse_connections = True
    guarded.server.drop_connections()
    seen = guarded.run_until_state(ArmingState.FAULT)
    with guarded.lock:
        guarded.model.power_cycle()
    tells(guarded, Reason.GUARD_BLIND)
    assert guarded.outputs[seen].reason is Reason.ARM_LINK_LOST
    assert Reason.GUARD_BLIND.label in guarded.outputs[-1].detail
    guarded.server.refuse_connections = False
    tells(guarded, None)
    guarded.reachable = True
    stands(guarded)
    recovers_from_fault(guarded)
    is_logged(guarded, Reason.ARM_LINK_LOST)


def test_a_guard_that_alone_loses_the_arm_stops_it_and_finds_it_again(
    tmp_path: Path, make_bench: MakeBench
) -> None:
    bench = make_bench(tmp_path)
    drivers = {each.connection for each in bench.model.since(-1)}
    bench.add_guard()
    bench.engage_and_move(SIDEWAYS / 4)
    bench.server.is_cut = lambda frame: threading.get_native_id() not in drivers
    seen = bench.run_until_state(ArmingState.FAULT)
    is_stopped(bench, seen, Reason.GUARD_BLIND)
    tells(bench, Reason.GUARD_BLIND)
    bench.server.is_cut = lambda frame: False
    tells(bench, None)
    recovers_from_fault(bench)
    is_logged(bench, Reason.GUARD_BLIND)
