"""An emergency stop reaches the arm at once, also while the control loop stands still."""

from __future__ import annotations

import os
import signal
import threading

import pytest

from tams_app.faces.terminal.keys import handled_signals
from tams_app.teleop.safety import ArmingState, Reason
from tests.faults.promises import is_logged, moving_connections, recovers_from_fault, stands
from tests.faults.wired_bench import WiredBench

pytestmark = pytest.mark.timed


def stops_without_a_tick(bench: WiredBench) -> None:
    """The stop goes out before the loop's next tick, which knows the reason and stays stopped."""
    last = bench.now
    bench.until(lambda: any(each.is_stop for each in bench.requests(last)))
    stop = next(each for each in bench.requests(last) if each.is_stop)
    assert stop.tick == last, "no tick has begun since"
    assert stop.connection not in moving_connections(bench)
    bench.until(lambda: not bench.model.moving)
    position = bench.position
    assert bench.tick().arming is ArmingState.FAULT
    assert bench.outputs[-1].reason is Reason.EMERGENCY_STOP
    assert abs(bench.position - position).max() < 1e-9
    bench.run_until(lambda output: not output.stop)
    stands(bench)


def test_an_emergency_stop_does_not_wait_for_the_control_loop(wired_bench: WiredBench) -> None:
    wired_bench.engage_and_move()
    wired_bench.signals.estop()
    stops_without_a_tick(wired_bench)
    recovers_from_fault(wired_bench)
    is_logged(wired_bench, Reason.EMERGENCY_STOP)


def test_a_failed_session_stops_the_arm_over_the_same_way(wired_bench: WiredBench) -> None:
    wired_bench.engage_and_move()
    last = wired_bench.now
    wired_bench.signals.fail()
    wired_bench.until(lambda: any(each.is_stop for each in wired_bench.requests(last)))
    assert wired_bench.tick().reason is Reason.SESSION_FAILED


def test_the_signal_stops_the_arm_while_the_main_thread_holds_what_a_stop_needs(
    wired_bench: WiredBench,
) -> None:
    """In a handler it would wait for ever for a lock of the thread that it interrupted."""
    bench = wired_bench
    bench.engage_and_move()
    ended: list[str] = []
    with handled_signals(ended.append, bench.signals.estop, lambda *why: pytest.fail(str(why))):
        with bench.gate._lock:
            os.kill(os.getpid(), signal.SIGUSR1)
            threading.Event().wait(0.05)
        stops_without_a_tick(bench)
    assert ended == []
