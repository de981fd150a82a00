"""The controller stopped by itself: an error, or a state that obeys no more."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from hw.lite6.codes import ErrorCode, StateCommand
from tams_app.records import Activity, ArmState, Tick
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
    any_bench: Bench, code: ErrorCode
) -> None:
    def shows(state: ArmState) -> bool:
        return state.fault is not None and state.fault.code == code

    bench = any_bench
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
        bench.until_seen(lambda state: state.activity is Activity.STOPPED)
        seen = bench.next
        bench.run_ticks(1)
        assert bench.outputs[seen].reason in (Reason.ARM_STOPPED, Reason.ARM_ERROR)
        bench.until_seen(lambda state: state.fault is not None)
        assert bench.run_ticks(1).detail.startswith("C31 (collision): remove what it hit")
        bench.run_until(lambda output: not output.stop)
        only_stops(bench, seen)
        recovers_from_fault(bench)
    finally:
        bench.close()


def pause(bench: Bench) -> None:
    bench.model.set_state(StateCommand.PAUSE)


def stop(bench: Bench) -> None:
    bench.model.set_state(StateCommand.STOP)


def change(bench: Bench) -> None:
    bench.model.configuration_changed()


@pytest.mark.parametrize(
    ("elsewhere", "activity"),
    [(pause, Activity.PAUSED), (stop, Activity.STOPPED), (change, Activity.STOPPED)],
    ids=["state 3", "state 4", "state 5"],
)
def test_an_arm_that_was_halted_from_elsewhere_is_stopped_in_the_tick_that_sees_it(
    any_bench: Bench, elsewhere: Callable[[Bench], None], activity: Activity
) -> None:
    bench = any_bench
    bench.engage_and_move()
    bench.quiesce()
    with bench.lock:
        elsewhere(bench)
    bench.until_seen(lambda arm: arm.activity is activity)
    seen = bench.next
    bench.run_ticks(1)
    assert sees(bench.ticks[seen], activity)
    is_stopped(bench, seen, Reason.ARM_STOPPED)
    recovers_from_fault(bench)
    is_logged(bench, Reason.ARM_STOPPED)


def sees(tick: Tick, activity: Activity) -> bool:
    return tick.arm is not None and tick.arm.activity is activity
