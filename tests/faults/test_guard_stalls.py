"""A control loop that stalls: the guard stops the arm in its place.

The guard is the real process, against the controller on TCP, beside the real driver.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from tams_app.teleop.safety import ArmingState, Reason
from tests.faults.promises import is_logged, is_stopped, moving_connections, recovers_from_fault
from tests.faults.wire import Request
from tests.faults.wired_bench import MakeBench, WiredBench

pytestmark = [pytest.mark.timed, pytest.mark.usefixtures("real_time")]

TIMEOUT_MS = 100.0


@pytest.fixture(params=["velocity", "pose"])
def guarded(
    request: pytest.FixtureRequest, real_time: None, tmp_path: Path, make_bench: MakeBench
) -> WiredBench:
    """An arm that moves under a guard which stops it after 100 ms of silence."""
    bench = make_bench(request.param, folder=tmp_path)
    bench.add_guard(TIMEOUT_MS)
    bench.engage_and_move()
    return bench


def stops_between(bench: WiredBench, first: int, after: int) -> list[Request]:
    return [each for each in bench.requests(first) if each.is_stop and each.tick < after]


def test_a_short_stall_of_the_control_loop_changes_nothing(guarded: WiredBench) -> None:
    bench = guarded
    since = bench.next
    bench.stall(0.050)
    bench.run_ticks(20)
    assert {output.arming for output in bench.outputs[since:]} == {ArmingState.ENGAGED}
    assert stops_between(bench, since - 1, bench.next) == []


@pytest.mark.parametrize("stall_ms", [200, 1000])
def test_the_guard_stops_the_arm_of_a_stalled_loop_which_then_knows_why(
    guarded: WiredBench, stall_ms: int
) -> None:
    bench = guarded
    connections = {each.connection for each in bench.requests(0)}
    seen = bench.next
    bench.stall(stall_ms / 1000)
    stop = stops_between(bench, seen - 1, seen)[0]
    assert stop.connection not in connections, "the guard has one of its own"
    assert stop.connection not in moving_connections(bench)
    position = bench.position
    bench.run_ticks(1)
    assert abs(bench.positions[-1] - position).max() < 1e-9, "at rest before the loop went on"
    is_stopped(bench, seen, Reason.GUARD_STOPPED)
    recovers_from_fault(bench)
    is_logged(bench, Reason.GUARD_STOPPED)
