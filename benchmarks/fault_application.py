"""The application without frames: real control loop, driver and guard, and a hand at full speed.

Specification: control_port, report_port, fault (see `_faults`, happens on SIGUSR1), folder.
Ready facts: guard_pid; said when the arm is engaged and the hand begins to move.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from hw.arms import session_boundary
from hw.controller import Controller
from hw.lite6.arm import Lite6
from tams_app.config import Config, load_config
from tams_app.records import (
    ControllerSample,
    ControllerStatus,
    Haptic,
    Pose,
    Record,
    Tick,
    Vector,
)
from tams_app.robot import build
from tams_app.robot.arm_gate import ArmGate
from tams_app.robot.control import ControlLoop, LoopDevices, Signals
from tams_app.robot.guarding import Guarding
from tams_app.robot.listener import Listener
from tams_app.robot.video import video_delay_ns
from tams_app.rotation import Rotation
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.process import HelperSide
from tams_app.runtime.realtime import APPLICATION_PRIORITY, use_fifo, use_round_robin
from tams_app.runtime.worker import Worker
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.repair import repair_rule

STALL_S = 0.2
PATIENCE_S = 20.0
POLL_S = 0.01
_FRESH_NS, _STALE_NS = 60 * NS_PER_MS, 5 * NS_PER_S
_NETWORK = "s2"
_ALONG_Y = np.array([0.0, 0.3, 0.0])  # more than the arm's full speed: clamped to that


class SteadyHand(Controller):
    """Moves at `velocity` [m/s], in the arm's base frame, and trembles as living hands do."""

    def __init__(self, config: Config) -> None:
        self.velocity: Vector = np.zeros(3)
        self.trigger = 0.0
        self.stall_s = 0.0  # the next sample takes so long, once
        self._from_base = np.array(config.hand.rotation).T
        self._random = np.random.default_rng(7)
        self._position = np.array([0.0, 1.0, -0.3])
        self._last_ns: int | None = None

    def start(self) -> None:
        """Nothing to connect to."""

    def sample(self, now_ns: int) -> ControllerSample:
        stall_s, self.stall_s = self.stall_s, 0.0
        if stall_s:
            time.sleep(stall_s)
        elapsed_s = 0.0 if self._last_ns is None else (now_ns - self._last_ns) / NS_PER_S
        self._last_ns = now_ns
        self._position = self._position + self._from_base @ self.velocity * elapsed_s
        pose = Pose(self._position + self._random.uniform(-2e-5, 2e-5, 3), Rotation.identity())
        return ControllerSample.released(ControllerStatus.OK, pose, now_ns, now_ns, self.trigger)

    def pulse(self, haptic: Haptic) -> None:
        """Not felt here."""

    def close(self) -> None:
        """Nothing to let go of."""


class Application(Listener):
    """Control loop, gate and guard around one arm, as the session wires them."""

    def __init__(self, config: Config, folder: Path) -> None:
        self.config = config
        self.clock = MonotonicClock()
        self.signals = Signals()
        self.hand = SteadyHand(config)
        self.video_age_ns = _FRESH_NS
        self.arming = ArmingState.DISARMED
        self.arm = Lite6(config.arm, self.clock, config.control.rate_hz)
        self.gate = ArmGate(
            self.arm,
            session_boundary(config.arm, config.limits),
            _ignore,
        )
        self.guarding = Guarding(config.arm, config.limits, folder, self.signals, _ignore)

    def start(self) -> list[Worker]:
        """Connect and run; the threads, last started first."""
        use_round_robin(APPLICATION_PRIORITY)
        self.guarding.start()
        self.arm.connect()
        priority = self.config.control.realtime_priority
        for thread_id in self.arm.realtime_thread_ids.values():
            use_fifo(priority - 1, thread_id)
        self.guarding.wait_ready()
        loop = self._control_loop()

        def control(stop: object) -> None:
            use_fifo(priority)
            loop.run(stop)  # type: ignore[arg-type]

        workers = [Worker("control", control), Worker("arm-gate", self.gate.run)]
        for worker in reversed(workers):
            worker.start()
        return workers

    def arm_and_engage(self) -> None:
        """What the operator does; then the hand begins to move."""
        deadline_s = time.monotonic() + PATIENCE_S
        self.signals.confirm(self.clock.now_ns())
        self._await(ArmingState.READY, deadline_s)
        self.hand.trigger = 1.0
        self._await(ArmingState.ENGAGED, deadline_s)
        time.sleep(0.1)
        self.hand.velocity = _ALONG_Y

    def close(self, workers: list[Worker]) -> None:
        for worker in workers:
            worker.stop(PATIENCE_S)
        self.arm.close()
        self.guarding.close()

    def _await(self, state: ArmingState, deadline_s: float) -> None:
        while self.arming is not state:
            if time.monotonic() > deadline_s:
                raise TimeoutError(f"the arm is {self.arming.value}, not {state.value}")
            time.sleep(POLL_S)

    def _control_loop(self) -> ControlLoop:
        config = self.config
        network = config.networks[_NETWORK]
        self.delay_ns = video_delay_ns(network, repair_rule(network, 300.0))
        return build.control_loop(
            config,
            self.clock,
            LoopDevices(self.hand, self.arm, self.gate, self),  # type: ignore[arg-type]
            self.delay_ns,
            self.signals,
            (self.guarding, self),
        )

    def age_ns(self, view: str, now_ns: int) -> int:
        return self.video_age_ns

    def is_damaged(self, view: str) -> bool:
        return False

    def receive(self, record: Record) -> None:
        if isinstance(record, Tick):
            self.arming = ArmingState(record.arming)


def _ignore(*_: object) -> None:
    """Not listened to."""


def _faults(application: Application) -> dict[str, Callable[[], None]]:
    def release() -> None:
        application.hand.trigger = 0.0

    def hide_the_video() -> None:
        application.video_age_ns = _STALE_NS

    def stall() -> None:
        application.hand.stall_s = STALL_S

    return {
        "deadman released": release,
        "stale video": hide_the_video,
        "emergency stop": application.signals.estop,
        "control loop stalled 200 ms": stall,
    }


def main() -> None:
    side = HelperSide()
    specification = side.specification
    overrides = {
        "arm.control_port": specification["control_port"],
        "arm.report_port": specification["report_port"],
    }
    application = Application(load_config(overrides=overrides), Path(specification["folder"]))
    fault = _faults(application).get(specification["fault"])
    if fault is not None:
        signal.signal(signal.SIGUSR1, lambda *_: fault())
    workers = application.start()
    try:
        application.arm_and_engage()
        side.ready(guard_pid=application.guarding.process.pid)
        side.stop_requested.wait()
    finally:
        application.close(workers)


if __name__ == "__main__":
    main()
