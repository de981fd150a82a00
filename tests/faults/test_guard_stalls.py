"""A control loop that stalls: the guard stops the arm in its place.

The guard is the real process, against the controller on TCP, beside the real driver.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from tams_app.teleop.safety import ArmingState, Reason
from tests.faults.promises import is_logged, is_stopped, moving_connections, recovers_from_fault
from tests.faults.wire import Request
from tests.faults.wired_bench import MakeBench, WiredBench

pytestmark = [
    pytest.mark.timed,
    pytest.mark.second_chance(standstill_ms=30),  # with the stall of 50 ms nearly the guard's time
    pytest.mark.usefixtures("real_time"),
]


def guarded(make_bench: MakeBench, folder: Path, promise: Callable[[WiredBench], None]) -> None:
    """The promise of an arm that moves under a guard which stops it after 100 ms of silence."""
    bench = make_bench(folder)
    bench.add_guard()
    bench.engage_and_move()
    promise(bench)


def stops_between(bench: WiredBench, first: int, after: int) -> list[Request]:
    return [each for each in bench.requests(first) if each.is_stop and each.tick < after]


def test_a_short_stall_of_the_control_loop_changes_nothing(
    make_bench: MakeBench, tmp_path: Path
) -> None:
    def promise(bench: WiredBench) -> None:
        since = bench.next
        bench.stall(0.050)
        bench.run_ticks(20)
        assert {output.arming for output in bench.outputs[since:]} == {ArmingState.ENGAGED}
        assert stops_between(bench, since - 1, bench.next) == []

    guarded(make_bench, tmp_path, promise)


@pytest.mark.parametrize("stall_ms", [200, 1000])
def test_the_guard_stops_the_arm_of_a_stalled_loop_which_then_knows_why(
    make_bench: MakeBench, tmp_path: Path, stall_ms: int
) -> None:
    def promise(bench: WiredBench) -> None:
        connections = {each.connection for each in bench.requests(0)}
        seen = bench.next
        bench.stall(stall_ms / 1000)
        bench.until(lambda: stops_between(bench, seen - 1, seen) != [])
        bench.until(lambda: not bench.model.moving)  # at rest before the loop goes on
        stop = stops_between(bench, seen - 1, seen)[0]
        assert stop.connection not in connections, "the guard has one of its own"
        assert stop.connection not in moving_connections(bench)
        position = bench.position
        bench.run_ticks(1)
        assert abs(bench.positions[-1] - position).max() < 1e-9
        is_stopped(bench, seen, Reason.GUARD_STOPPED)
        recovers_from_fault(bench)
        is_logged(bench, Reason.GUARD_STOPPED)

    guarded(make_bench, tmp_path, promise)
