"""An arm that does not move as the control loop says: the guard stops it, while the loop beats on.

The guard is the real process, against the controller on TCP, beside the real driver. The commands
are another program's, or those of a defect between control loop and wire.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from tams_app.records import Twist, Vector
from tams_app.teleop.safety import ArmingState, Reason
from tests.faults.bench import FULL_SPEED_M_S
from tests.faults.promises import is_logged, moving_connections, recovers_from_fault
from tests.faults.wired_bench import MakeBench, WiredBench

pytestmark = [pytest.mark.timed, pytest.mark.second_chance(standstill_ms=60)]

SLOWLY = np.array([0.0, 0.03, 0.0])
TO_THE_BASE = np.array([-0.12, 0.0, 0.0])
MOST_M = 0.05  # that the arm may move against what the beats say


@pytest.fixture
def bench(tmp_path: Path, make_bench: MakeBench) -> WiredBench:
    made = make_bench(tmp_path)
    made.add_guard()
    return made


def bend(bench: WiredBench, bent: Callable[[Vector], Vector]) -> Callable[[], None]:
    """From now on the wire carries another velocity than was decided; returns what ends that."""
    send = bench.arm.send_twist

    def send_bent(twist: Twist) -> None:
        x, y, z = bent(np.array(twist.linear)).tolist()
        send(Twist((x, y, z), tuple(twist.angular)))  # type: ignore[arg-type]

    bench.arm.send_twist = send_bent  # type: ignore[method-assign]

    def straighten() -> None:
        bench.arm.send_twist = send  # type: ignore[method-assign]

    return straighten


def is_stopped_by_the_guard(bench: WiredBench, since: int, reason: Reason) -> None:
    """State 4 over the guard's own connection, while every beat came in time."""
    seen = bench.run_until_state(ArmingState.FAULT)
    assert bench.outputs[seen].reason is reason, bench.ticks[seen].reason
    own = {each.connection for each in bench.requests(-1) if each.tick < 0}
    bench.run_until(lambda output: not output.stop)
    # the application, which hears of it at once, may be the first to stop the arm
    stops = {each.connection for each in bench.requests(since) if each.is_stop}
    assert stops - (moving_connections(bench) | own)
    bench.run_ticks(3)


def test_an_arm_that_moves_while_ready_is_stopped(bench: WiredBench) -> None:
    bench.arm_it()
    bench.run(0.5)
    first = bench.next
    straighten = bend(bench, lambda _: np.array([0.0, 0.1, 0.0]))
    is_stopped_by_the_guard(bench, first, Reason.ARM_MOVED_UNASKED)
    assert bench.travel_m(first) < MOST_M
    assert {output.arming for output in bench.outputs[first:-1]} >= {ArmingState.READY}
    straighten()
    bench.hand.trigger = 0.0
    bench.run_ticks(3)
    bench.signals.confirm(bench.clock.now_ns())
    bench.run_until_state(ArmingState.DISARMED)
    assert Reason.ARM_MOVED_UNASKED.label in {tick.reason for tick in bench.read_back().ticks}


def test_an_arm_that_goes_on_after_the_release_is_stopped(bench: WiredBench) -> None:
    bench.engage_and_move(SLOWLY)
    straighten = bend(bench, lambda _: SLOWLY)
    bench.hand.trigger = 0.0
    first = bench.next
    is_stopped_by_the_guard(bench, first, Reason.ARM_MOVED_UNASKED)
    assert bench.travel_m(first) < MOST_M
    straighten()


def test_an_arm_that_is_faster_than_commanded_is_stopped(bench: WiredBench) -> None:
    bench.engage_and_move(SLOWLY)
    first = bench.next
    straighten = bend(bench, lambda _: np.array([0.0, FULL_SPEED_M_S, 0.0]))
    is_stopped_by_the_guard(bench, first, Reason.ARM_TOO_FAST)
    straighten()
    recovers_from_fault(bench)
    is_logged(bench, Reason.ARM_TOO_FAST)


def test_an_arm_that_leaves_the_workspace_is_stopped(bench: WiredBench) -> None:
    """As slowly as commanded, and the loop's following error is not large yet."""
    bench.engage_and_move(TO_THE_BASE)
    bench.run_until(lambda _: radius_m(bench) < 0.2)
    bench.hand.velocity = SLOWLY
    bench.run(0.3)
    first = bench.next
    straighten = bend(bench, lambda _: np.array([-0.05, 0.0, 0.0]))
    is_stopped_by_the_guard(bench, first, Reason.ARM_OUTSIDE)
    straighten()
    beyond_m = bench.config.limits.radius_min_mm / 1000 - radius_m(bench)
    assert 0.0 < beyond_m - bench.config.arm.boundary_margin_mm / 1000 < 0.01


def radius_m(bench: WiredBench) -> float:
    return float(np.hypot(*bench.position[:2]))
