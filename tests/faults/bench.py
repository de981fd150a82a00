"""The control loop on a bench: real teleoperation and the real controller model in virtual time.

Ticks are counted from 0; whatever happens before the first one belongs to tick -1. Everything that
a tick saw, said and sent is kept under its number.
"""

from __future__ import annotations

import threading
from pathlib import Path
from typing import Protocol

import numpy as np
from scipy.spatial.transform import Rotation

from hw.arm import ServoMode
from hw.boundary import session_boundary
from hw.sim.controller_codes import Register
from hw.sim.inprocess_arm import InProcessArm
from hw.sim.plant import IdealPlant
from tams_app.clock import NS_PER_MS, NS_PER_S, MonotonicClock, VirtualClock
from tams_app.config import Config, load_config
from tams_app.policy.weights import WeightMatrix
from tams_app.recording import Recorder, SessionLog, read_log
from tams_app.records import (
    StopRecord,
    Tick,
    Vector,
)
from tams_app.session import build
from tams_app.session.control import ControlHooks, ControlLoop
from tams_app.session.signals import Signals
from tams_app.session.stops import StopWatch
from tams_app.session.supervisor import ArmSupervisor
from tams_app.session.uplink import primary_age_ns
from tams_app.teleop.records import TeleopOutput
from tams_app.teleop.safety import ArmingState
from tams_app.teleop.safety import Request as ArmRequest
from tams_app.video.repair import repair_rule
from tests.synthetic_session import header

from .hand import Hand
from .wire import Request, TappedModel

RATE_HZ = 120
PERIOD_NS = round(NS_PER_S / RATE_HZ)
PERIOD_S = PERIOD_NS / NS_PER_S
PICTURE_DELAY_NS = 60 * NS_PER_MS
NETWORK = "s2"
FULL_SPEED_M_S = 0.25
ACROSS = np.array([0.0, FULL_SPEED_M_S, 0.0])  # free way of 200 mm from the ready pose
DOWN = np.array([0.0, 0.0, -0.08])


def configuration(servo: str = "velocity") -> Config:
    """The default configuration with that servo."""
    return load_config(overrides={"arm.servo": servo})


class Sight(Protocol):
    """What the operator sees: the part of `Uplink` that the control loop asks."""

    def age_ns(self, view: str, now_ns: int) -> int | None:
        """Age of the picture shown of `view`."""


class Pictures:
    """Each view some time old, or frozen."""

    def __init__(self, clock: VirtualClock) -> None:
        self._clock = clock
        self._captured_ns: dict[str, int] = {}

    def freeze(self, *views: str) -> None:
        """From now on the picture of these views stays what it is."""
        shown_ns = self._clock.now_ns() - PICTURE_DELAY_NS
        self._captured_ns.update(dict.fromkeys(views, shown_ns))

    def thaw(self) -> None:
        """All views move again."""
        self._captured_ns.clear()

    def age_ns(self, view: str, now_ns: int) -> int | None:
        return now_ns - self._captured_ns.get(view, now_ns - PICTURE_DELAY_NS)


class Bench:
    """Hand, arm, pictures and signals at the test's disposal; `tick` and `run` move time."""

    def __init__(
        self, servo: str = "velocity", log: Path | None = None, sight: Sight | None = None
    ) -> None:
        """With a `log` every tick goes through the recorder into that file; see `read_back`.

        `sight` takes the place of `pictures`.
        """
        self.config = configuration(servo)
        self.servo = ServoMode(servo)
        self.clock = VirtualClock()
        ready = np.radians(np.array(self.config.arm.ready_joints_deg))
        self.model = TappedModel(IdealPlant(), start_joints=ready)
        self.model.tick = -1
        self.arm = InProcessArm(self.config.arm, self.clock, self.model)
        self.arm.connect()
        self.hand = Hand(self.config)
        self.signals = Signals()
        self.pictures = Pictures(self.clock)
        self.notes: list[str] = []
        self.ticks: list[Tick] = []
        self.outputs: list[TeleopOutput] = []
        self.stops: list[StopRecord] = []
        self.positions: list[Vector] = []  # of the TCP as it truly is, at the end of each tick
        self.beats: list[int] = []
        self._log_path = log
        self._recorder = None if log is None else _recorder(log)
        self._supervisor = ArmSupervisor(
            self.arm,
            self.servo,
            session_boundary(self.config.arm, self.config.limits),
            lambda level, text: self.notes.append(text),
        )
        self._stop_watch = StopWatch(self._keep_stop)
        self._asked = False
        weights = WeightMatrix(self.config.policy.weights.matrix)
        network = self.config.networks[NETWORK]
        self.loop = ControlLoop(
            self.clock,
            float(RATE_HZ),
            self.hand,
            self.arm,
            build.teleop(self.config, build.picture_delay_ns(network, repair_rule(network, 300.0))),
            build.phase_tracker(self.config),
            build.smoothed_speed(self.config),
            self.signals,
            ControlHooks(
                beat=self.beats.append,
                video_age_ns=primary_age_ns(sight or self.pictures, weights.primary_view),  # type: ignore[arg-type]
                request=self._ask,
                arm_ready=lambda: self._supervisor.ready,
                phase_began=lambda change: None,
                record=self._keep_tick,
                output=self._observe,
            ),
        )

    # --- time -----------------------------------------------------------------------------------

    def tick(self, after_ns: int = PERIOD_NS) -> TeleopOutput:
        """One tick of the control loop, `after_ns` after the last one."""
        self.arm.advance(after_ns)
        self.model.tick = len(self.outputs)
        output = self.loop.tick(self.clock.now_ns())
        self.outputs.append(output)
        self.positions.append(self.position)
        if self._asked:
            self._asked = False
            self._supervisor.run(_OnePass())
        return output

    def run(self, seconds: float) -> TeleopOutput:
        """Tick for that long; the last tick's output."""
        for _ in range(round(seconds * RATE_HZ)):
            output = self.tick()
        return output

    def run_until(self, state: ArmingState, within_s: float = 3.0) -> int:
        """Tick until the arming is in `state`; the number of that tick."""
        for _ in range(round(within_s * RATE_HZ)):
            if self.tick().arming is state:
                return self.now
        raise AssertionError(f"not {state} within {within_s} s, but {self.outputs[-1]}")

    @property
    def now(self) -> int:
        """The number of the last tick."""
        return len(self.outputs) - 1

    @property
    def next(self) -> int:
        """The number of the tick to come: in it, what is done now becomes visible."""
        return len(self.outputs)

    # --- what an operator does ------------------------------------------------------------------

    def arm_it(self) -> None:
        """Confirm with the trigger up, until the arm is ready."""
        self.run(0.2)
        self.signals.confirm()
        self.run_until(ArmingState.READY)

    def engage(self) -> None:
        """Hold the trigger, the hand at rest."""
        self.hand.velocity = np.zeros(3)
        self.hand.trigger = 1.0
        self.run_until(ArmingState.ENGAGED)

    def engage_and_move(self, velocity: Vector = ACROSS, seconds: float = 0.45) -> None:
        """From power-on to a steady motion with `velocity` [m/s]."""
        self.arm_it()
        self.engage()
        self.run(0.05)
        self.hand.velocity = velocity
        self.run(seconds)
        assert self.outputs[-1].arming is ArmingState.ENGAGED

    # --- what can be seen -----------------------------------------------------------------------

    @property
    def position(self) -> Vector:
        """Of the TCP as it truly is [m]."""
        position: Vector = self.model.tcp[:3, 3].copy()
        return position

    def commands(self, first: int, last: int | None = None) -> list[Vector | None]:
        """What each tick from `first` to before `last` (default: all) put on the wire.

        Linear [m/s] and angular [rad/s] velocity, shape (6,); None where no motion was sent. Pose
        servo: the way from the pose before, over the time between them.
        """
        found: dict[int, Vector] = {}
        before: Request | None = None
        for request in self.model.wire:
            if not request.is_motion:
                continue
            assert request.tick not in found, f"two motion commands in tick {request.tick}"
            found[request.tick] = _velocity(request, before)
            before = request
        return [found.get(tick) for tick in range(first, last or self.next)]

    def velocities(self, first: int, last: int | None = None) -> Vector:
        """As `commands`, where every tick sent a motion: shape (ticks, 6)."""
        sent = self.commands(first, last)
        assert all(velocity is not None for velocity in sent), "a tick without a motion command"
        return np.array(sent)

    def travel_m(self, first: int, last: int | None = None) -> float:
        """How far the TCP truly was, at most, from where it was before tick `first` [m]."""
        start = self.positions[first - 1]
        later = self.positions[first : last or self.next]
        return max(float(np.linalg.norm(position - start)) for position in later)

    def read_back(self) -> SessionLog:
        """Close the log and read it."""
        assert self._recorder is not None
        assert self._log_path is not None
        self._stop_watch.finish()
        self._recorder.close()
        return read_log(self._log_path)

    def close(self) -> None:
        """Let go of arm and log; may be called twice."""
        self.arm.close()
        if self._recorder is not None:
            self._recorder.close()

    # --- hooks of the control loop --------------------------------------------------------------

    def _ask(self, request: ArmRequest) -> None:
        self._supervisor.request(request)
        self._asked = True

    def _observe(self, now_ns: int, output: TeleopOutput, arm: object) -> None:
        if output.stop:  # as session.observer does
            self._supervisor.stopped()
        self._stop_watch.observe(now_ns, output, self.arm.state())

    def _keep_tick(self, tick: Tick) -> None:
        self.ticks.append(tick)
        if self._recorder is not None:
            self._recorder.record(tick)

    def _keep_stop(self, stop: StopRecord) -> None:
        self.stops.append(stop)
        if self._recorder is not None:
            self._recorder.record(stop)


class _OnePass(threading.Event):
    """A stop event for a worker's body that is to do what is queued and return."""

    def __init__(self) -> None:
        super().__init__()
        self._looked = False

    def is_set(self) -> bool:
        looked, self._looked = self._looked, True
        return looked


def _recorder(path: Path) -> Recorder:
    def fail(name: str, failure: BaseException) -> None:
        raise AssertionError(f"{name} failed") from failure

    recorder = Recorder(path, header(started_ns=0), MonotonicClock(), 0.0, fail)
    recorder.start()
    return recorder


def _velocity(request: Request, before: Request | None) -> Vector:
    if request.register == Register.SET_CARTESIAN_VELOCITY:
        return request.velocity
    if before is None or before.payload == request.payload:
        return np.zeros(6)
    here, there = (
        np.frombuffer(each.payload[:24], dtype="<f4").astype(np.float64)
        for each in (before, request)
    )
    turn = Rotation.from_rotvec(there[3:]) * Rotation.from_rotvec(here[3:]).inv()
    way = np.concatenate(((there[:3] - here[:3]) / 1000.0, turn.as_rotvec()))
    velocity: Vector = way * NS_PER_S / (request.now_ns - before.now_ns)
    return velocity
