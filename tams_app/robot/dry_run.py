"""An arm for everything but motion: connected and watched for real, its commands go to a model."""

from __future__ import annotations

import threading
from contextlib import ExitStack
from dataclasses import replace

from hw.arm import Arm, SimulatedArm, TcpBoundary
from hw.arms import simulated_arm
from tams_app.config import ArmConfig
from tams_app.errors import DeviceError
from tams_app.records import ArmState, CommandLink, LinkFault, Twist
from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_MS, NS_PER_S

SILENT_NS = 500 * NS_PER_MS  # of the real arm's reports, which come every 10 ms
LONGEST_STANDSTILL_NS = NS_PER_S

_NOT_CONNECTED = "The arm is not connected; connect it first."
_SILENT = "The arm has stopped reporting; check its power and network cable, then confirm."


class DryRunArm(Arm):
    """Connects, checks, watches and stops the arm `real`, and never moves it.

    A simulation of it, which begins where the real arm stands, takes the commands, and `state` is
    the simulation's. A failing link and an error of the real arm show as in a real run. From any
    thread: one lock guards the simulation.
    """

    def __init__(
        self, real: Arm, config: ArmConfig, clock: Clock, boundary: TcpBoundary | None = None
    ) -> None:
        """`boundary`: what the real arm's controller receives, for the model as well."""
        self._real = real
        self._config, self._clock, self._boundary = config, clock, boundary
        self._lock = threading.Lock()
        self._model: SimulatedArm | None = None

    def connect(self) -> None:
        """Connect the real arm with all its checks, and begin the model where it stands."""
        self._real.connect()
        state = self._real.state()
        if state is None:
            raise DeviceError(_SILENT)
        model = simulated_arm(
            self._config,
            self._clock,
            state.joints,
            self._boundary,
            gripper_closed=state.gripper_closed,
        )
        model.connect()
        with self._lock:
            self._model = model

    def enable(self) -> None:
        self._check_real()
        with self._lock:
            self._required().enable()

    def begin_move_to_joints(self, joints: list[float], speed: float) -> None:
        self._check_real()
        with self._lock:
            self._required().begin_move_to_joints(joints, speed)

    def state(self) -> ArmState | None:
        """The model's state, with the real controller's error if it has one."""
        real = self._real.state()
        with self._lock:
            model = self._caught_up()
            state = model.state() if model is not None else None
        if state is None or real is None or real.fault is None:
            return state
        return replace(state, fault=real.fault)

    def link(self) -> CommandLink:
        """The model's link; the real arm's failure if it has one, or has fallen silent."""
        with self._lock:
            model = self._caught_up()
            if model is None:
                return CommandLink(0, 0, 0, 0, _NOT_CONNECTED, LinkFault.LOST)
            link = model.link()
        real = self._real.link()
        if real.failure:
            return replace(link, failure=real.failure, fault=real.fault)
        if self._real_is_silent():
            return replace(link, failure=_SILENT, fault=LinkFault.LOST)
        return link

    def send_twist(self, twist: Twist) -> None:
        with self._lock:
            if (model := self._caught_up()) is not None:
                model.send_twist(twist)

    def set_gripper(self, closed: bool) -> None:
        with self._lock:
            if (model := self._caught_up()) is not None:
                model.set_gripper(closed)

    def stop(self) -> None:
        """Stop the model, and the real arm too, whatever program may be moving it."""
        self._real.stop()
        with self._lock:
            if (model := self._caught_up()) is not None:
                model.stop()

    def clear_errors(self) -> None:
        """Clear the real arm's errors and the model's."""
        self._real.clear_errors()
        with self._lock:
            self._required().clear_errors()

    def close(self) -> None:
        with ExitStack() as closing:
            closing.callback(self._real.close)
            with self._lock:
                model, self._model = self._model, None
            if model is not None:
                model.close()

    @property
    def realtime_thread_ids(self) -> dict[str, int]:
        return self._real.realtime_thread_ids

    def _caught_up(self) -> SimulatedArm | None:
        """The model; after a standstill of the process it does not relive all of it."""
        if self._model is not None:
            self._model.skip_standstill(LONGEST_STANDSTILL_NS)
        return self._model

    def _required(self) -> SimulatedArm:
        model = self._caught_up()
        if model is None:
            raise DeviceError(_NOT_CONNECTED)
        return model

    def _check_real(self) -> None:
        """DeviceError if the real arm could not be moved either."""
        link, state = self._real.link(), self._real.state()
        if link.failure:
            raise DeviceError(link.failure)
        if state is None or self._real_is_silent():
            raise DeviceError(_SILENT)
        if state.fault is not None:
            raise DeviceError(state.fault.sentence)

    def _real_is_silent(self) -> bool:
        state = self._real.state()
        return state is None or self._clock.now_ns() - state.received_ns > SILENT_NS
