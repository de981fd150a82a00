"""The controller stopped by itself: an error, or a state that obeys no more."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from hw.lite6.protocol import ErrorCode, StateCommand
from hw.sim.controller.core import outputs_for
from hw.sim.controller.model import ControllerModel
from tams_app.records import Activity, ArmState, Phase
from tams_app.teleop.safety import Reason
from tests.faults.bench import Bench
from tests.faults.promises import is_logged, is_stopped, only_stops, recovers_from_fault
from tests.faults.wired_bench import WiredBench

pytestmark = pytest.mark.waiting

ERRORS = (*(code.value for code in ErrorCode), 60)  # 60, too fast, the model never raises itself
READ_AGAIN_S = 1.1  # the gripper's outputs, by the bench's clock


Event = Callable[[ControllerModel], None]


def stops_for(
    bench: Bench, event: Event, shows: Callable[[ArmState], bool], reason: Reason, detail: str = ""
) -> None:
    """What happens to the controller of a moving arm stops it in the tick that sees it."""
    bench.engage_and_move()
    bench.quiesce()
    with bench.lock:
        event(bench.model)
    bench.until_seen(shows)
    seen = bench.next
    bench.run_ticks(1)
    arm = bench.ticks[seen].arm
    assert arm is not None
    assert shows(arm)
    is_stopped(bench, seen, reason, detail)


@pytest.mark.parametrize("code", ERRORS, ids=lambda code: f"C{code}")
def test_an_error_of_the_controller_stops_the_arm_in_the_tick_that_sees_it(
    bench: Bench, code: int
) -> None:
    def happens(model: ControllerModel) -> None:
        """As the controller does by itself; C2 by its button."""
        if code == ErrorCode.EMERGENCY_STOP:
            model.press_emergency_stop()
        else:
            model.raise_error(code)

    def shows(state: ArmState) -> bool:
        return state.fault is not None and state.fault.code == code

    stops_for(bench, happens, shows, Reason.ARM_ERROR, f"C{code} (")
    recovers_from_fault(bench, bench.model.release_emergency_stop)
    is_logged(bench, Reason.ARM_ERROR)


@pytest.mark.parametrize("drive_code", [15, 23], ids=lambda code: f"S{code}")
def test_an_error_of_a_joints_drive_is_cleared_by_enabling_the_motors_first(
    bench: Bench, drive_code: int
) -> None:
    stops_for(
        bench,
        lambda model: model.raise_drive_error(2, drive_code),
        lambda state: state.fault is not None,
        Reason.ARM_ERROR,
        f"C12 (motor of joint 2 failed, S{drive_code}",
    )
    recovers_from_fault(bench)
    is_logged(bench, Reason.ARM_ERROR)


def close_gripper(bench: Bench) -> None:
    """The arm follows the hand, its gripper closed."""
    bench.engage_and_move()
    bench.hand.a = True
    bench.run_ticks(3)
    bench.hand.a = False
    bench.until_seen(lambda state: state.gripper_closed is True)
    bench.run(0.2)
    assert bench.ticks[-1].phase in (Phase.GRASP, Phase.TRANSPORT)
    bench.quiesce()


def test_a_gripper_whose_power_was_cut_is_not_known_and_nothing_is_claimed_to_be_held(
    bench: Bench,
) -> None:
    close_gripper(bench)
    with bench.lock:
        bench.model.press_emergency_stop()
    bench.until_seen(lambda state: state.fault is not None)
    bench.run_ticks(1)
    arm = bench.ticks[-1].arm
    assert arm is not None
    assert arm.gripper_closed is None, "in the tick that sees the error"
    assert bench.ticks[-1].phase is Phase.REACH
    bench.run_until(lambda output: not output.stop)
    recovers_from_fault(bench, bench.model.release_emergency_stop)
    known = {tick.arm.gripper_closed for tick in bench.ticks[-50:] if tick.arm is not None}
    assert known == {None}, "it is not driven"
    assert bench.ticks[-1].phase is Phase.REACH


def test_a_gripper_that_an_error_may_have_switched_is_not_known_until_it_was_read_again(
    wired_bench: WiredBench,
) -> None:
    close_gripper(wired_bench)
    with wired_bench.lock:
        wired_bench.model.raise_error(ErrorCode.COLLISION)  # which leaves the outputs as they are
    wired_bench.until_seen(lambda state: state.fault is not None)
    seen = wired_bench.next
    wired_bench.run_until(lambda output: not output.stop)
    wired_bench.run(READ_AGAIN_S)
    assert {tick.arm.gripper_closed for tick in wired_bench.ticks[seen:] if tick.arm} == {None}
    recovers_from_fault(wired_bench)
    wired_bench.until_seen(lambda state: state.gripper_closed is True)


def test_a_gripper_whose_outputs_a_stop_switches_off_is_not_known_once_the_stop_is_reported(
    bench: Bench,
) -> None:
    with bench.lock:
        bench.model.settings.clear_outputs_on_stop = True
    close_gripper(bench)
    bench.run(0.3)  # a report has the setting five times a second
    bench.signals.estop()
    bench.until_seen(lambda state: state.activity is Activity.STOPPED)
    seen = bench.next
    bench.run(0.5)
    assert {tick.arm.gripper_closed for tick in bench.ticks[seen:] if tick.arm} == {None}
    assert bench.ticks[-1].phase is Phase.REACH


def test_a_gripper_that_another_program_opened_is_reported_open(bench: Bench) -> None:
    close_gripper(bench)
    with bench.lock:
        bench.model.settings.tool_outputs = outputs_for(False)
    bench.run(READ_AGAIN_S)
    bench.until_seen(lambda state: state.gripper_closed is False)
    bench.run_ticks(1)
    assert Phase.RELEASE in {tick.phase for tick in bench.ticks[-200:]}


def test_an_error_that_the_state_told_of_first_is_named_as_soon_as_it_is_known(
    tmp_path: Path,
) -> None:
    """With the true report rates: states at 100 Hz, errors at 5 Hz."""
    with closing(WiredBench(folder=tmp_path)) as bench:
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


@pytest.mark.parametrize(
    ("elsewhere", "activity"),
    [
        (lambda model: model.set_state(StateCommand.PAUSE), Activity.PAUSED),
        (lambda model: model.set_state(StateCommand.STOP), Activity.STOPPED),
        (lambda model: model.configuration_changed(), Activity.STOPPED),
    ],
    ids=["state 3", "state 4", "state 5"],
)
def test_an_arm_that_was_halted_from_elsewhere_is_stopped_in_the_tick_that_sees_it(
    bench: Bench, elsewhere: Event, activity: Activity
) -> None:
    stops_for(bench, elsewhere, lambda arm: arm.activity is activity, Reason.ARM_STOPPED)
    recovers_from_fault(bench)
    is_logged(bench, Reason.ARM_STOPPED)
