"""One rig per arm: the driver over TCP in real time; in this process, the model and a toy."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, nullcontext
from dataclasses import replace

import numpy as np
import pytest

from hw.arm import Arm, TcpBoundary
from hw.arms import ARM_KINDS, arm_kind, session_boundary
from hw.lite6.arm import Lite6
from hw.lite6.commands import LIMITS as LITE6_LIMITS
from hw.lite6.protocol import ErrorCode, Register, ReplyBit, State
from hw.sim.controller.inprocess_arm import InProcessArm
from hw.sim.controller.model import ControllerModel, IdealPlant, ReportKind
from hw.sim.controller.server import ControllerServer
from tams_app.config import ArmConfig, LimitsConfig
from tams_app.config.motion import ControlConfig
from tams_app.records import ArmState, Twist
from tams_app.runtime.clock import MonotonicClock, VirtualClock
from tams_app.units import NS_PER_S
from tests.contract.toy_arm import BUMPED, BUTTON, ToyArm, ToyBox
from tests.contract.toy_arm import LIMITS as TOY_LIMITS

BOUNDARY = session_boundary(ArmConfig(), LimitsConfig())
READY_JOINTS = np.radians(ArmConfig().ready_joints_deg)
CONTROL_RATE_HZ = ControlConfig().rate_hz
WITHIN_S = 10.0  # generous: the machine may be busy


class ArmRig(ABC):
    """An arm that stands at its ready pose, a way to let time pass, and what can go wrong."""

    limits = LITE6_LIMITS  # 1.2 times as much is commanded and must be refused
    ready_joints = READY_JOINTS  # [rad]
    rest_mm, rest_rad = 1e-3, 1e-6  # reports of an arm that stands differ by less
    deadman_s = ArmConfig().velocity_deadman_s
    collision: str  # how the arm's controller names it
    gripper_attempts: int  # at a command that the controller refuses

    @abstractmethod
    def advance(self, seconds: float) -> None:
        """Let time [s] pass for the arm: sleep, or advance a simulation."""

    @abstractmethod
    def elapsed_s(self) -> float:
        """The time that `advance` has let pass [s], from any start."""

    def until(self, condition: Callable[[], bool]) -> bool:
        """Let time pass until a condition, checked every 10 ms, holds; False if not within 10 s."""
        deadline_s = self.elapsed_s() + WITHIN_S
        while self.elapsed_s() < deadline_s:
            if condition():
                return True
            self.advance(0.01)
        return False

    def next_state(self, arm: Arm, reports: int = 2) -> ArmState:
        """The newest report, after so many from now on: the first may have been on its way."""
        for _ in range(reports):
            before = arm.state()
            received_ns = before.received_ns if before else 0
            newer = self.until(lambda t_ns=received_ns: _received_ns(arm) > t_ns)
            assert newer, "the arm's reports have stopped"
        state = arm.state()
        assert state is not None
        return state

    def stream(self, arm: Arm, twist: Twist, seconds: float) -> None:
        """Send a twist to an enabled arm like a control loop, 120 times a second."""
        for _ in range(round(seconds * CONTROL_RATE_HZ)):
            arm.send_twist(twist)
            self.advance(1.0 / CONTROL_RATE_HZ)

    @abstractmethod
    def make_arm(self, boundary: TcpBoundary | None = BOUNDARY) -> Arm:
        """Another driver of the same controller, not connected."""

    @abstractmethod
    def is_stopped(self) -> bool:
        """Whether the controller itself has stopped."""

    @abstractmethod
    def gripper_driven(self) -> bool | None:
        """Whether the controller drives the gripper closed or open; None: neither."""

    @abstractmethod
    def collide(self) -> None:
        """Let the arm meet an obstacle."""

    @abstractmethod
    def press_emergency_stop(self, pressed: bool = True) -> None:
        """Press or release the button."""

    @abstractmethod
    def freeze_reports(self) -> None:
        """Let no report leave the controller from now on."""

    @abstractmethod
    def spoil_gripper(self, how: str) -> None:
        """Gripper commands are refused ("refuses"), or acknowledged and not done ("ignores")."""

    @abstractmethod
    def mend_gripper(self) -> None:
        """Gripper commands are done again."""


def _received_ns(arm: Arm) -> int:
    state = arm.state()
    return 0 if state is None else state.received_ns


def raised(boundary: TcpBoundary, height_mm: float) -> TcpBoundary:
    x, y, _ = boundary.lower_mm
    return replace(boundary, lower_mm=(x, y, round(height_mm)))


class Lite6Rig(ArmRig):
    """The Lite 6's controller model, whatever drives it."""

    collision = "C31"
    gripper_attempts = 3

    def __init__(self) -> None:
        self.model = ControllerModel(IdealPlant(), start_joints=READY_JOINTS)
        self._handle = self.model.handle

    @property
    @abstractmethod
    def model_lock(self) -> AbstractContextManager[object]:
        """To be held while the test does something to the model."""

    def is_stopped(self) -> bool:
        with self.model_lock:
            return self.model.state is State.STOPPED

    def gripper_driven(self) -> bool | None:
        with self.model_lock:
            return self.model.settings.closing

    def collide(self) -> None:
        with self.model_lock:
            self.model.raise_error(ErrorCode.COLLISION)

    def press_emergency_stop(self, pressed: bool = True) -> None:
        with self.model_lock:
            if pressed:
                self.model.press_emergency_stop()
            else:
                self.model.release_emergency_stop()

    def freeze_reports(self) -> None:
        with self.model_lock:
            self.model.reports_frozen = True

    def spoil_gripper(self, how: str) -> None:
        answer = bytes([ReplyBit.INVALID]) if how == "refuses" else bytes(1)

        def deaf(register: int, payload: bytes, now_ns: int) -> bytes:
            if register != Register.TOOL_GPIO_WRITE:
                return self._handle(register, payload, now_ns)
            return answer

        self.model.handle = deaf  # type: ignore[method-assign]

    def mend_gripper(self) -> None:
        self.model.handle = self._handle  # type: ignore[method-assign]


class TcpRig(Lite6Rig):
    """The real driver and SDK against the controller model on loopback, in real time."""

    def __init__(self) -> None:
        super().__init__()
        self.server = ControllerServer(self.model)
        self.server.start()

    def make_arm(self, boundary: TcpBoundary | None = BOUNDARY) -> Arm:
        ports = self.server.ports
        config = ArmConfig(
            control_port=ports.control,
            report_port=ports.report,
            reply_timeout_s=0.5,  # both ends share one busy process here
        )
        return Lite6(config, MonotonicClock(), CONTROL_RATE_HZ, boundary)

    def advance(self, seconds: float) -> None:
        time.sleep(seconds)

    def elapsed_s(self) -> float:
        return time.monotonic()

    @property
    def model_lock(self) -> AbstractContextManager[object]:
        return self.server.lock

    def close(self) -> None:
        self.server.close()


class TimelessRig(ArmRig):
    """Time passes only when the test says so."""

    def __init__(self) -> None:
        super().__init__()
        self._clock = VirtualClock()
        self._arm: Arm | None = None

    def advance(self, seconds: float) -> None:
        assert self._arm is not None
        self._clock.advance_ns(round(seconds * NS_PER_S))
        self._arm.state()

    def elapsed_s(self) -> float:
        return self._clock.now_ns() / NS_PER_S


class VirtualRig(TimelessRig, Lite6Rig):
    """The in-process arm."""

    def make_arm(self, boundary: TcpBoundary | None = BOUNDARY) -> Arm:
        self._arm = InProcessArm(ArmConfig(), self._clock, self.model, boundary)
        return self._arm

    @property
    def model_lock(self) -> AbstractContextManager[object]:
        return nullcontext()


class ToyRig(TimelessRig):
    """The second arm, by its word in the configuration."""

    limits = TOY_LIMITS
    collision = "T7"
    gripper_attempts = 1

    def __init__(self) -> None:
        super().__init__()
        self._box: ToyBox | None = None

    def make_arm(self, boundary: TcpBoundary | None = BOUNDARY) -> Arm:
        config = ArmConfig(model="toy")
        arm = arm_kind(config.model).make_arm(config, self._clock, CONTROL_RATE_HZ, boundary)
        assert isinstance(arm, ToyArm)
        self._box = arm.box = self._box or arm.box
        self._arm = arm
        return arm

    @property
    def box(self) -> ToyBox:
        assert self._box is not None
        return self._box

    def is_stopped(self) -> bool:
        return not self.box.runs

    def gripper_driven(self) -> bool | None:
        return self.box.gripper_closed

    def collide(self) -> None:
        self.box.halt(BUMPED)

    def press_emergency_stop(self, pressed: bool = True) -> None:
        self.box.button_pressed = pressed
        if pressed:
            self.box.halt(BUTTON)

    def freeze_reports(self) -> None:
        self.box.reports_frozen = True

    def spoil_gripper(self, how: str) -> None:
        self.box.gripper_works = how

    def mend_gripper(self) -> None:
        self.box.gripper_works = "yes"


@pytest.fixture(params=["tcp", "virtual", "toy"])
def rig(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[ArmRig]:
    # setting up waits for the 5 Hz report several times; tests/hw/lite6/test_arm.py has its rate
    monkeypatch.setattr(ReportKind, "rate_hz", property(lambda _: 100))
    monkeypatch.setitem(ARM_KINDS, "toy", "tests.contract.toy_arm:KIND")
    with ExitStack() as cleaning:
        if request.param == "tcp":
            tcp = TcpRig()
            cleaning.callback(tcp.close)
            yield tcp
        else:
            yield VirtualRig() if request.param == "virtual" else ToyRig()


@pytest.fixture
def unconnected(rig: ArmRig) -> Iterator[Arm]:
    arm = rig.make_arm()
    yield arm
    arm.close()


@pytest.fixture
def arm(unconnected: Arm) -> Arm:
    unconnected.connect()
    return unconnected


@pytest.fixture
def enabled(arm: Arm) -> Arm:
    arm.enable()
    return arm
