"""The arm answers, and refuses: motion, the stop, getting ready, the gripper; or is not fit."""

from __future__ import annotations

import re
import struct
from collections.abc import Iterator

import pytest

from hw.arm import Arm
from hw.lite6.arm import Lite6
from hw.lite6.protocol import Register, ReplyBit, State
from hw.sim.controller.inprocess_arm import InProcessArm
from tams_app.config import ArmConfig
from tams_app.errors import DeviceError
from tams_app.records import Tick
from tams_app.runtime.clock import MonotonicClock, VirtualClock
from tams_app.teleop.safety import ArmingState, Reason
from tests.faults.bench import Bench
from tests.faults.promises import is_logged, is_stopped, recovers_from_fault, reengages
from tests.faults.wire import TappedModel, tapped_model
from tests.faults.wired_bench import FaultyServer, WiredBench

pytestmark = pytest.mark.waiting

INVALID = bytes([ReplyBit.INVALID])
NOT_READY = bytes([ReplyBit.NOT_READY])
REFUSALS = 5
OUTPUT_OPEN = struct.pack(">i", 0b01)  # of the tool: the gripper opens


def refuse(bench: Bench, *registers: int, reply: bytes = INVALID) -> None:
    """From now on requests of these registers are answered with `reply` and not done."""
    bench.model.interpose = lambda register, _: reply if register in registers else None


def obey(bench: Bench) -> None:
    bench.model.interpose = lambda register, payload: None


def refused(tick: Tick) -> bool:
    return tick.link.failure != ""


# --- motion, stop, state ------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("reply", "detail"),
    [(INVALID, "refused a motion command"), (NOT_READY, "stopped and refuses to move")],
    ids=["invalid", "not ready"],
)
def test_a_refused_motion_command_stops_the_arm_in_the_tick_that_sees_it(
    wired_bench: WiredBench, reply: bytes, detail: str
) -> None:
    wired_bench.engage_and_move()
    wired_bench.quiesce()
    refuse(wired_bench, Register.SET_CARTESIAN_VELOCITY, reply=reply)
    since = wired_bench.next
    wired_bench.run_ticks(1)
    wired_bench.until(lambda: wired_bench.arm.link().failure != "")
    wired_bench.run_ticks(1)
    seen = wired_bench.first_seen(refused, since)
    assert seen == since + 1
    is_stopped(wired_bench, seen, Reason.ARM_REFUSES, detail)
    recovers_from_fault(wired_bench, lambda: obey(wired_bench))
    is_logged(wired_bench, Reason.ARM_REFUSES)


def test_a_refused_stop_is_repeated_until_it_is_acknowledged(wired_bench: WiredBench) -> None:
    wired_bench.engage_and_move()
    stops = 0

    def refuse_some_stops(register: int, payload: bytes) -> bytes | None:
        nonlocal stops
        if register != Register.SET_STATE or payload[0] != State.STOPPED:
            return None
        stops += 1
        return INVALID if stops <= REFUSALS else None

    wired_bench.model.interpose = refuse_some_stops
    wired_bench.signals.estop()
    seen = wired_bench.next
    is_stopped(wired_bench, seen, Reason.EMERGENCY_STOP)
    assert stops > REFUSALS
    with wired_bench.lock:
        assert wired_bench.model.state == State.STOPPED
    recovers_from_fault(wired_bench)


def test_an_arm_that_does_not_get_ready_stays_disarmed_and_stopped_and_says_why(
    bench: Bench,
) -> None:

    def refuse_ready(register: int, payload: bytes) -> bytes | None:
        return INVALID if register == Register.SET_STATE and payload[0] == 0 else None

    bench.model.interpose = refuse_ready
    bench.run_ticks(3)
    bench.signals.confirm(bench.clock.now_ns())
    bench.run_until(lambda output: bool(bench.notes))
    bench.run_ticks(20)
    assert "refused" in bench.notes[0]
    assert {output.arming for output in bench.outputs} == {ArmingState.DISARMED}
    assert not any(request.is_motion for request in bench.requests(0))
    with bench.lock:
        assert bench.model.state >= State.STOPPED
    obey(bench)
    bench.arm_it()
    reengages(bench)


# --- gripper ------------------------------------------------------------------------------------


def test_a_refused_gripper_command_stops_the_arm(bench: Bench) -> None:
    bench.engage_and_move()
    bench.quiesce()
    refuse(bench, Register.TOOL_GPIO_WRITE)
    since = bench.next
    bench.hand.a = True
    seen = bench.run_until_state(ArmingState.FAULT)
    bench.hand.a = False
    assert seen == bench.first_seen(refused, since)
    assert bench.outputs[seen].gripper is None
    is_stopped(bench, seen, Reason.GRIPPER_FAILED, "refused")
    assert bench.ticks[-1].arm is not None
    assert bench.ticks[-1].arm.gripper_closed is None, "what was refused is not what it does"
    recovers_from_fault(bench, lambda: obey(bench))
    is_logged(bench, Reason.GRIPPER_FAILED)


def test_a_gripper_that_does_not_do_what_it_acknowledged_stops_the_arm(
    wired_bench: WiredBench,
) -> None:
    wired_bench.engage_and_move()
    opened = bytes(1) + OUTPUT_OPEN
    refuse(wired_bench, Register.TOOL_GPIO_READ, reply=opened)
    since = wired_bench.next
    wired_bench.hand.a = True
    seen = wired_bench.run_until_state(ArmingState.FAULT)
    wired_bench.hand.a = False
    assert seen == wired_bench.first_seen(refused, since)
    is_stopped(wired_bench, seen, Reason.GRIPPER_FAILED, "not what was commanded")
    assert wired_bench.ticks[-1].arm is not None
    assert wired_bench.ticks[-1].arm.gripper_closed is False, "what was read back"
    recovers_from_fault(wired_bench, lambda: obey(wired_bench))


# --- an arm that is not fit ---------------------------------------------------------------------


class Connecting:
    """A controller to connect to, and a driver of it."""

    def __init__(self, kind: str) -> None:
        self.model = tapped_model()
        self.server: FaultyServer | None = None
        if kind == "virtual":
            self.arm: Arm = InProcessArm(ArmConfig(), VirtualClock(), self.model)
            return
        self.server = FaultyServer(self.model)
        self.server.start()
        ports = self.server.ports
        config = ArmConfig(
            control_port=ports.control, report_port=ports.report, reply_timeout_s=0.3
        )
        self.arm = Lite6(config, MonotonicClock())

    def close(self) -> None:
        self.arm.close()
        if self.server is not None:
            self.server.close()


@pytest.fixture(params=["wired", "virtual"])
def connecting(request: pytest.FixtureRequest, frequent_reports: None) -> Iterator[Connecting]:
    made = Connecting(str(request.param))
    yield made
    made.close()


def nothing_but_stops(model: TappedModel) -> bool:
    return all(request.is_query or request.is_stop for request in model.wire)


# As another program may have left the control box: what is said of it, and where to change it
FOREIGN: dict[str, tuple[object, str]] = {
    "simulation_robot": (True, "only pretends to move; switch its simulation mode off"),
    "reduced": ((50.0, 0.35), "reduced mode, at most 50 mm/s; set limits.max_speed_mm_s instead"),
    "collision_rebound": (True, "after a collision; switch collision rebound off"),
    "approximate_motion": (True, "near singularities; switch approximation off"),
    "gravity": ((0.0, 0.26, -0.966), "mounted at an angle; mount it upright"),
    "world_offset": ((0.0, 0.0, 5.0, 0.0, 0.0, 0.0), "with an offset; set that offset to zero"),
}


@pytest.mark.parametrize("setting", FOREIGN)
def test_an_arm_that_another_program_set_up_to_move_otherwise_is_refused_until_that_is_undone(
    connecting: Connecting, setting: str
) -> None:
    settings, (value, sentence) = connecting.model.settings, FOREIGN[setting]
    before = getattr(settings, setting)
    setattr(settings, setting, value)
    with pytest.raises(DeviceError, match=sentence) as refused:
        connecting.arm.connect()
    assert "UFACTORY Studio" in str(refused.value)
    assert nothing_but_stops(connecting.model)
    setattr(settings, setting, before)
    connecting.arm.connect()
    assert connecting.arm.state() is not None


@pytest.mark.parametrize("setting", FOREIGN)
def test_a_setting_that_another_program_changes_while_the_arm_moves_stops_it_until_undone(
    wired_bench: WiredBench, setting: str
) -> None:
    bench, (value, sentence) = wired_bench, FOREIGN[setting]
    before = change_while_moving(bench, setting, value, sentence)
    bench.hand.trigger = 0.0
    bench.run_ticks(3)
    bench.signals.confirm(bench.clock.now_ns())
    bench.run_ticks(20)
    assert bench.outputs[-1].arming is ArmingState.FAULT, "not before it is undone"
    bench.hand.trigger = 1.0
    bench.run_ticks(3)
    recovers_from_fault(bench, lambda: setattr(bench.model.settings, setting, before))
    is_logged(bench, Reason.ARM_REFUSES)


OWN: dict[str, tuple[object, str]] = {
    "tcp_offset": ((0.0, 0.0, 100.0, 0.0, 0.0, 0.0), "TCP offset"),
    "load": ((0.5, 0.0, 0.0, 0.0), "load"),
    "collision_sensitivity": (0, "collision sensitivity"),
    "self_collision_check": (False, "self-collision check"),
}


@pytest.mark.parametrize("setting", OWN)
def test_a_setting_of_ours_that_another_program_changes_stops_the_arm_and_is_set_back(
    wired_bench: WiredBench, setting: str
) -> None:
    bench, (value, name) = wired_bench, OWN[setting]
    sentence = f"The arm's {name} is not what TAMS had set; close other programs"
    before = change_while_moving(bench, setting, value, sentence)
    recovers_from_fault(bench)
    with bench.lock:
        assert getattr(bench.model.settings, setting) == before
    is_logged(bench, Reason.ARM_REFUSES)


def change_while_moving(bench: WiredBench, setting: str, value: object, sentence: str) -> object:
    """What it was before; the arm stops in the tick that sees the change."""
    bench.engage_and_move()
    bench.quiesce()
    with bench.lock:
        before: object = getattr(bench.model.settings, setting)
        setattr(bench.model.settings, setting, value)
    bench.until(lambda: bench.arm.link().failure != "")
    assert re.search(sentence, bench.arm.link().failure)
    seen = bench.next
    bench.run_ticks(1)
    is_stopped(bench, seen, Reason.ARM_REFUSES)
    return before


def test_firmware_that_would_not_stop_by_itself_is_refused_and_taken_when_updated(
    connecting: Connecting,
) -> None:
    connecting.model.firmware = "1.7.9"
    with pytest.raises(DeviceError, match=r"firmware 1\.7\.9 is older than 1\.8\.0"):
        connecting.arm.connect()
    assert nothing_but_stops(connecting.model)
    connecting.model.firmware = "2.6.0"
    connecting.arm.connect()
    assert connecting.arm.state() is not None
