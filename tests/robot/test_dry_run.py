"""The dry run: the arm is connected and watched, and never moved."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import pytest

from hw.arms import session_boundary
from hw.lite6.arm import Lite6
from hw.lite6.protocol import Register, State
from hw.sim.controller.inprocess_arm import InProcessArm
from hw.sim.controller.model import CYCLE_NS, ControllerModel, IdealPlant, ReportKind
from tams_app.config import ArmConfig, LimitsConfig
from tams_app.errors import DeviceError
from tams_app.records import Activity, LinkFault, Twist
from tams_app.robot.dry_run import DryRunArm
from tams_app.runtime.clock import MonotonicClock, VirtualClock
from tams_app.units import NS_PER_S
from tests.faults.wire import TappedModel
from tests.hw.lite6.controller_rig import ControllerRig, until

pytestmark = pytest.mark.waiting

READY = np.radians(ArmConfig().ready_joints_deg)
SIDEWAYS = Twist(np.array([0.0, 0.05, 0.0]), np.zeros(3))
HARMLESS = {  # all that a dry run may ask of the real arm: to tell, to stop, and its settings
    Register.GET_VERSION,
    Register.GET_STATE,
    Register.GET_ERROR,
    Register.TOOL_GPIO_READ,
    Register.SET_STATE,
    Register.CLEAN_ERROR,
    Register.CLEAN_WARNING,
    Register.SET_COLLISION_SENSITIVITY,
    Register.SET_SELF_COLLISION_CHECK,
    Register.SET_TCP_OFFSET,
    Register.SET_BOUNDARY,
    Register.SET_FENCE,
    253,  # the SDK asks which feedback it is sent, on connecting
    254,  # and chooses none
}


class TappedRig(ControllerRig):
    """A served controller model with a tap, and a dry run of the driver that reaches it."""

    model: TappedModel

    def __init__(self) -> None:
        super().__init__(TappedModel(IdealPlant(), READY))
        config, clock = self.config(), MonotonicClock()
        boundary = session_boundary(config, LimitsConfig())
        self.arm = DryRunArm(Lite6(config, clock, 120.0, boundary), config, clock, boundary)


@pytest.fixture
def rig(monkeypatch: pytest.MonkeyPatch) -> Iterator[TappedRig]:
    monkeypatch.setattr(ReportKind, "rate_hz", property(lambda _: 100))
    made = TappedRig()
    yield made
    made.arm.close()
    made.server.close()


def activity(arm: DryRunArm) -> Activity | None:
    state = arm.state()
    return None if state is None else state.activity


def fault_code(arm: DryRunArm) -> int | None:
    state = arm.state()
    return None if state is None or state.fault is None else state.fault.code


def moved_mm(arm: DryRunArm, start: np.ndarray) -> float:
    state = arm.state()
    assert state is not None
    return float(np.linalg.norm(state.tcp.position - start)) * 1000.0


def test_in_a_dry_run_everything_works_and_nothing_that_moves_reaches_the_arm(
    rig: TappedRig,
) -> None:
    arm = rig.arm
    arm.connect()
    arm.enable()
    before = arm.state()
    assert before is not None
    start = before.tcp.position

    def far() -> bool:
        arm.send_twist(SIDEWAYS)
        return moved_mm(arm, start) > 10.0

    assert until(far)
    arm.set_gripper(True)
    assert until(lambda: (state := arm.state()) is not None and state.gripper_closed is True)
    arm.stop()
    arm.clear_errors()
    arm.enable()
    arm.send_twist(SIDEWAYS)
    arm.stop()
    arm.begin_move_to_joints((READY + 0.05).tolist(), 0.5)
    assert until(lambda: moved_mm(arm, start) < 9.0 or moved_mm(arm, start) > 15.0)
    assert arm.link().failure == ""
    arm.close()
    assert {request.register for request in rig.model.wire} <= HARMLESS
    states = {request.payload for request in rig.model.wire if request.register == 12}
    assert states == {bytes([State.STOPPED])}
    np.testing.assert_array_equal(rig.model.joints, READY)


def test_a_stop_reaches_the_real_arm_too(rig: TappedRig) -> None:
    rig.arm.connect()
    rig.arm.enable()
    with rig.server.lock:
        rig.model.wire.clear()
    rig.arm.stop()
    assert until(lambda: any(request.is_stop for request in rig.model.wire))
    assert until(lambda: activity(rig.arm) is Activity.STOPPED)


def test_a_lost_link_of_the_real_arm_is_a_lost_link_and_clearing_errors_mends_it(
    rig: TappedRig,
) -> None:
    rig.arm.connect()
    rig.arm.enable()
    rig.server.drop_connections()
    assert until(lambda: rig.arm.link().fault is LinkFault.LOST)
    with pytest.raises(DeviceError):
        rig.arm.enable()
    rig.arm.clear_errors()
    assert rig.arm.link().fault is LinkFault.NONE
    rig.arm.enable()


def test_reports_of_the_real_arm_that_freeze_are_a_lost_link(rig: TappedRig) -> None:
    rig.arm.connect()
    rig.model.reports_frozen = True
    assert until(lambda: rig.arm.link().fault is LinkFault.LOST)
    assert "reporting" in rig.arm.link().failure


def test_an_error_of_the_real_arm_shows_and_keeps_it_from_being_enabled(rig: TappedRig) -> None:
    rig.arm.connect()
    with rig.server.lock:
        rig.model.press_emergency_stop()
    assert until(lambda: fault_code(rig.arm) == 2)
    with pytest.raises(DeviceError, match="C2"):
        rig.arm.enable()


def test_before_connecting_nothing_breaks(rig: TappedRig) -> None:
    rig.arm.send_twist(SIDEWAYS)
    rig.arm.set_gripper(True)
    rig.arm.stop()
    assert rig.arm.state() is None
    assert rig.arm.link().fault is LinkFault.LOST
    with pytest.raises(DeviceError, match="connect"):
        rig.arm.enable()


def virtual_dry_run(clock: VirtualClock) -> tuple[InProcessArm, DryRunArm]:
    real = InProcessArm(ArmConfig(), clock, TappedModel(IdealPlant(), READY))
    arm = DryRunArm(real, ArmConfig(), clock)
    return real, arm


@pytest.mark.parametrize("closed", [True, False])
def test_the_model_begins_with_the_real_arms_joints_and_gripper(closed: bool) -> None:
    clock = VirtualClock()
    real, arm = virtual_dry_run(clock)
    real.connect()
    real.enable()
    real.set_gripper(closed)
    real.close()
    arm.connect()
    state = arm.state()
    assert state is not None
    np.testing.assert_array_equal(state.joints, READY)
    assert state.gripper_closed is closed


def test_a_standstill_of_the_process_is_not_relived(monkeypatch: pytest.MonkeyPatch) -> None:
    clock = VirtualClock()
    real, arm = virtual_dry_run(clock)
    arm.connect()
    arm.enable()
    clock.advance_ns(60 * NS_PER_S)
    real.skip_standstill(0)
    cycles = []
    step = ControllerModel.step

    def counted(model: ControllerModel, now_ns: int) -> None:
        cycles.append(now_ns)
        step(model, now_ns)

    monkeypatch.setattr(ControllerModel, "step", counted)
    arm.state()
    assert 200 < len(cycles) <= 250
    assert cycles[-1] > clock.now_ns() - 2 * CYCLE_NS
