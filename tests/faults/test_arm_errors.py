"""The controller stopped by itself: an error, or a state that obeys no more."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from hw.sim.controller.codes import ErrorCode, State
from tams_app.records import ArmState, Tick
from tams_app.teleop.safety import Reason
from tests.faults.bench import Bench
from tests.faults.promises import is_logged, is_stopped, only_stops, recovers_from_fault
from tests.faults.wired_bench import WiredBench

pytestmark = pytest.mark.waiting

ERRORS = tuple(ErrorCode)


def raise_error(bench: Bench, code: ErrorCode) -> None:
    """As the controller does by itself; C2 by its button."""
    if code is ErrorCode.EMERGENCY_STOP:
        bench.model.press_emergency_stop()
    else:
        bench.model.raise_error(code)


@pytest.mark.parametrize("code", ERRORS, ids=lambda code: f"C{code.value}")
def test_an_error_of_the_controller_stops_the_arm_in_the_tick_that_sees_it(
    either_bench: Bench, code: ErrorCode
) -> None:
    def shows(state: ArmState) -> bool:
        return state.error_code == code

    bench = either_bench
    bench.engage_and_move()
    bench.quiesce()
    with bench.lock:
        raise_error(bench, code)
    bench.until_seen(shows)
    seen = bench.next
    bench.run_ticks(1)
    is_stopped(bench, seen, Reason.ARM_ERROR, f"C{code.value} (")
    recovers_from_fault(bench, bench.model.release_emergency_stop)
    is_logged(bench, Reason.ARM_ERROR)


def test_an_error_that_the_state_told_of_first_is_named_as_soon_as_it_is_known(
    tmp_path: Path,
) -> None:
    """With the true report rates: states at 100 Hz, errors at 5 Hz."""
    bench = WiredBench(folder=tmp_path)
    try:
        bench.engage_and_move()
        bench.quiesce()
        with bench.lock:
            bench.model.raise_error(ErrorCode.COLLISION)
        bench.until_seen(lambda state: state.state == State.STOPPED)
        seen = bench.next
        bench.run_ticks(1)
        assert bench.outputs[seen].reason in (Reason.ARM_STOPPED, Reason.ARM_ERROR)
        bench.until_seen(lambda state: state.error_code == ErrorCode.COLLISION)
        assert bench.run_ticks(1).detail.startswith("C31 (collision): remove what it hit")
        bench.run_until(lambda output: not output.stop)
        only_stops(bench, seen)
        recovers_from_fault(bench)
    finally:
        bench.close()


def pause(bench: Bench) -> None:
    bench.model.set_state(State.PAUSED)


def stop(bench: Bench) -> None:
    bench.model.set_state(State.STOPPED)


def change(bench: Bench) -> None:
    bench.model.configuration_changed()


@pytest.mark.parametrize(
    ("elsewhere", "state"),
    [(pause, State.PAUSED), (stop, State.STOPPED), (change, State.CHANGED)],
    ids=["state 3", "state 4", "state 5"],
)
def test_an_arm_that_was_halted_from_elsewhere_is_stopped_in_the_tick_that_sees_it(
    any_bench: Bench, elsewhere: Callable[[Bench], None], state: State
) -> None:
    bench = any_bench
    bench.engage_and_move()
    bench.quiesce()
    with bench.lock:
        elsewhere(bench)
    bench.until_seen(lambda arm: arm.state == state)
    seen = bench.next
    bench.run_ticks(1)
    assert sees_state(bench.ticks[seen], state)
    is_stopped(bench, seen, Reason.ARM_STOPPED)
    recovers_from_fault(bench)
    is_logged(bench, Reason.ARM_STOPPED)


def sees_state(tick: Tick, state: State) -> bool:
    return tick.arm is not None and tick.arm.state == state
