"""One rig per kind of arm: the driver over TCP in real time, the in-process arm in virtual time."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, ExitStack, nullcontext

import numpy as np
import pytest

from hw.arm import Arm, ServoMode
from hw.boundary import TcpBoundary, session_boundary
from hw.lite6.arm import Lite6
from hw.sim.controller.inprocess_arm import InProcessArm
from hw.sim.controller.model import ControllerModel, ReportKind
from hw.sim.controller.plant import IdealPlant
from hw.sim.controller.server import ControllerServer
from tams_app.config import ArmConfig, LimitsConfig
from tams_app.records import ArmState, Twist
from tams_app.runtime.clock import NS_PER_S, MonotonicClock, VirtualClock

BOUNDARY = session_boundary(ArmConfig(), LimitsConfig())
READY_JOINTS = np.radians(ArmConfig().ready_joints_deg)
CONTROL_RATE_HZ = 120
WITHIN_S = 10.0  # generous: the machine may be busy


class ArmRig(ABC):
    """An arm that stands at the ready pose, the model behind it, and a way to let time pass."""

    def __init__(self) -> None:
        self.model = ControllerModel(IdealPlant(), start_joints=READY_JOINTS)

    @abstractmethod
    def make_arm(self, boundary: TcpBoundary | None = BOUNDARY) -> Arm:
        """Another driver of the same controller, not connected."""

    @abstractmethod
    def advance(self, seconds: float) -> None:
        """Let time pass for the arm."""

    @property
    @abstractmethod
    def model_lock(self) -> AbstractContextManager[object]:
        """To be held while the test does something to the model."""

    @abstractmethod
    def elapsed_s(self) -> float:
        """Of the time that `advance` lets pass."""

    def until(self, condition: Callable[[], bool]) -> bool:
        """Let time pass until `condition` holds; False if it does not in good time."""
        deadline_s = self.elapsed_s() + WITHIN_S
        while self.elapsed_s() < deadline_s:
            if condition():
                return True
            self.advance(0.01)
        return False

    def next_state(self, arm: Arm, reports: int = 2) -> ArmState:
        """A state that was measured after this call; never mind what is still on its way."""
        for _ in range(reports):
            self._await_report(arm)
        state = arm.state()
        assert state is not None
        return state

    def stream(self, arm: Arm, twist: Twist, seconds: float) -> None:
        """Send `twist` like a control loop."""
        for _ in range(round(seconds * CONTROL_RATE_HZ)):
            arm.send_twist(twist)
            self.advance(1.0 / CONTROL_RATE_HZ)

    def _await_report(self, arm: Arm) -> None:
        before = arm.state()
        received_ns = before.received_ns if before else 0

        def newer() -> bool:
            state = arm.state()
            return state is not None and state.received_ns > received_ns

        assert self.until(newer), "the arm's reports have stopped"


class TcpRig(ArmRig):
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


class VirtualRig(ArmRig):
    """The in-process arm; time passes only when the test says so."""

    def __init__(self) -> None:
        super().__init__()
        self._clock = VirtualClock()
        self._arms: list[InProcessArm] = []

    def make_arm(self, boundary: TcpBoundary | None = BOUNDARY) -> Arm:
        arm = InProcessArm(ArmConfig(), self._clock, self.model, boundary)
        self._arms.append(arm)
        return arm

    def advance(self, seconds: float) -> None:
        self._arms[-1].advance(round(seconds * NS_PER_S))

    def elapsed_s(self) -> float:
        return self._clock.now_ns() / NS_PER_S

    @property
    def model_lock(self) -> AbstractContextManager[object]:
        return nullcontext()


@pytest.fixture(params=["tcp", "virtual"])
def rig(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> Iterator[ArmRig]:
    # setting up waits for the 5 Hz report several times; tests/hw/lite6/test_arm.py has its rate
    monkeypatch.setattr(ReportKind, "rate_hz", property(lambda _: 100))
    with ExitStack() as cleaning:
        if request.param == "tcp":
            tcp = TcpRig()
            cleaning.callback(tcp.close)
            yield tcp
        else:
            yield VirtualRig()


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
    arm.enable(ServoMode.VELOCITY)
    return arm
