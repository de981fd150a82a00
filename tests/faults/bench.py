"""The control loop on a bench: real teleoperation over an arm, a hand and frames of the test.

Ticks are counted from 0; whatever happens before the first one belongs to tick -1. Everything that
a tick saw, said and sent is kept under its number. How time passes, and what lies between the loop
and the controller model, is the bench's kind: see `virtual_bench` and `wired_bench`.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from hw.arm import Arm
from hw.arms import session_boundary
from hw.lite6.kinematics import Lite6Model, offset_from_mm_deg
from tams_app.config import Config
from tams_app.recording import LOG_NAME, Recorder, SessionLog, read_log
from tams_app.records import ArmState, Note, Record, StopRecord, Tick, Vector
from tams_app.robot import build
from tams_app.robot.arm_gate import ArmGate
from tams_app.robot.control import LoopDevices, Signals
from tams_app.robot.listener import Listener
from tams_app.robot.observers import StopWatch
from tams_app.robot.video import video_delay_ns
from tams_app.runtime.clock import Clock
from tams_app.session.recorders import live_records
from tams_app.teleop.records import TeleopOutput
from tams_app.teleop.safety import ArmingState
from tams_app.teleop.safety import Request as ArmRequest
from tams_app.units import NS_PER_S
from tams_app.video.core.repair import repair_rule
from tests.faults.frames import Frames, Sight
from tests.faults.hand import Hand
from tests.faults.wire import Request, TappedModel

RATE_HZ = 120
PERIOD_NS = round(NS_PER_S / RATE_HZ)
PERIOD_S = PERIOD_NS / NS_PER_S
NETWORK = "s2"
FULL_SPEED_M_S = 0.25
ACROSS = np.array([0.0, FULL_SPEED_M_S, 0.0])  # free way of 200 mm from the ready pose
DOWN = np.array([0.0, 0.0, -0.08])
MOST_TICKS = 10 * RATE_HZ


@dataclass(frozen=True, slots=True)
class Pace:
    """How long a bench does things: short where a tick takes real time."""

    cruise: Vector  # [m/s] what `engage_and_move` asks for ...
    cruise_s: float  # ... until the motion is steady
    rest_s: float  # for which an engaged hand rests, to see that nothing moves
    move_s: float  # for which it moves then, to see that the arm follows
    standing_ticks: int  # for which an arm that stands is looked at


class Bench(Listener, ABC):
    """Hand, arm, frames and signals at the test's disposal; `tick` and `run` move time."""

    pace: Pace
    in_flight = 0  # motion commands, handed over a tick before, that may come after a stop

    def __init__(
        self,
        config: Config,
        clock: Clock,
        arm: Arm,
        model: TappedModel,
        folder: Path | None,
        sight: Sight | None = None,
    ) -> None:
        """`arm` is connected. With a `folder` all goes into a log there; see `read_back`.

        `sight` takes the place of `frames`.
        """
        self.config, self.clock, self.arm, self.model = config, clock, arm, model
        self.hand = Hand(config)
        self.signals = Signals()
        self.frames = Frames(clock)
        self.notes: list[str] = []
        self.ticks: list[Tick] = []
        self.outputs: list[TeleopOutput] = []
        self.stops: list[StopRecord] = []
        self.positions: list[Vector] = []  # of the TCP as it truly is, at the end of each tick
        self.beats: list[int] = []
        self.gate = ArmGate(
            arm,
            session_boundary(config.arm, config.limits),
            lambda level, text: self.notes.append(text),
        )
        self.cleaning = ExitStack()
        self.folder = folder
        self._recorder: Recorder | None = None
        if folder is not None:
            records = live_records(config, clock, folder, _fail)
            self._recorder, _bridge = self.cleaning.enter_context(records)
        self._stop_watch = StopWatch()
        self._kinematics = Lite6Model(offset_from_mm_deg(config.arm.tcp_offset_mm_deg))
        self._sight = sight or self.frames
        network = config.networks[NETWORK]
        self.delay_ns = video_delay_ns(network, repair_rule(network, 300.0))
        self.loop = build.control_loop(
            config,
            clock,
            LoopDevices(self.hand, arm, self, self),
            self.delay_ns,
            self.signals,
            (self,),
            (self._stop_watch,),
        )
        self.cleaning.callback(arm.close)

    # --- time -----------------------------------------------------------------------------------

    def tick(self, after_ns: int = PERIOD_NS) -> TeleopOutput:
        """One tick of the control loop, `after_ns` after the last one."""
        self._let_pass(after_ns)
        with self.lock:
            self.model.tick = self.next
        output = self.loop.tick(self.clock.now_ns())
        self.outputs.append(output)
        self._settle(output)
        self.positions.append(self.position)
        return output

    def run_ticks(self, count: int) -> TeleopOutput:
        """That many ticks; the last one's output."""
        for _ in range(count):
            output = self.tick()
        return output

    def run(self, seconds: float) -> TeleopOutput:
        """Tick for that long; the last tick's output."""
        return self.run_ticks(round(seconds * RATE_HZ))

    def run_until(self, holds: Callable[[TeleopOutput], bool], within: int = MOST_TICKS) -> int:
        """Tick until `holds` is true of a tick's output; that tick's number."""
        for _ in range(within):
            if holds(self.tick()):
                return self.now
        raise AssertionError(f"not within {within} ticks: {self.outputs[-1]}, notes {self.notes}")

    def run_until_state(self, state: ArmingState) -> int:
        """Tick until the arming is in `state`; that tick's number."""
        return self.run_until(lambda output: output.arming is state)

    @property
    def now(self) -> int:
        """The number of the last tick."""
        return len(self.outputs) - 1

    @property
    def next(self) -> int:
        """The number of the tick to come: in it, what is visible now will be seen."""
        return len(self.outputs)

    # --- what an operator does ------------------------------------------------------------------

    def arm_it(self) -> None:
        """Confirm with the trigger up, until the arm is ready."""
        self.run_ticks(3)
        self.signals.confirm(self.clock.now_ns())
        self.run_until_state(ArmingState.READY)

    def engage(self) -> None:
        """Hold the trigger, the hand at rest."""
        self.hand.velocity = np.zeros(3)
        self.hand.trigger = 1.0
        self.run_until_state(ArmingState.ENGAGED)

    def engage_and_move(self, velocity: Vector | None = None, seconds: float | None = None) -> None:
        """From power-on to a steady motion with `velocity` [m/s]; default: the bench's pace."""
        velocity = self.pace.cruise if velocity is None else velocity
        seconds = self.pace.cruise_s if seconds is None else seconds
        self.arm_it()
        self.engage()
        self.run(0.05)
        first = self.next
        self.hand.velocity = velocity
        self.run(seconds)
        assert self.outputs[-1].arming is ArmingState.ENGAGED, self.ticks[-1].reason
        assert self.travel_m(first) > 0.1 * float(np.linalg.norm(velocity)) * seconds, "it moves"

    # --- what can be seen -----------------------------------------------------------------------

    @property
    @abstractmethod
    def lock(self) -> AbstractContextManager[object]:
        """To be held while something is done to the model."""

    @property
    def position(self) -> Vector:
        """Of the configured TCP as it truly is [m]: the controller may have forgotten its tool."""
        with self.lock:
            joints = self.model.joints
        position: Vector = self._kinematics.tcp_matrix(joints)[:3, 3]
        return position

    def requests(self, first: int) -> list[Request]:
        """What was asked of the controller in tick `first` and later, other than how it is."""
        with self.lock:
            since = self.model.since(first)
        return [request for request in since if not request.is_query]

    def travel_m(self, first: int, last: int | None = None) -> float:
        """How far the TCP truly was, at most, from where it was before tick `first` [m]."""
        start = self.positions[first - 1]
        later = self.positions[first : last or self.next]
        return max(float(np.linalg.norm(position - start)) for position in later)

    def first_seen(self, sign: Callable[[Tick], bool], since: int) -> int:
        """The first tick from `since` on whose input shows `sign`."""
        return next(number for number in range(since, self.next) if sign(self.ticks[number]))

    def read_back(self) -> SessionLog:
        """Close the log and read it."""
        assert self._recorder is not None
        assert self.folder is not None
        for stop in self._stop_watch.finish():
            self.receive(stop)
        self._recorder.close()
        return read_log(self.folder / LOG_NAME)

    def close(self) -> None:
        """Let go of everything; may be called twice."""
        self.cleaning.close()

    # --- how time passes ------------------------------------------------------------------------

    @abstractmethod
    def _let_pass(self, duration_ns: int) -> None: ...

    @abstractmethod
    def _settle(self, output: TeleopOutput) -> None:
        """Let what the tick asked for reach the wire: it belongs to this tick."""

    @abstractmethod
    def quiesce(self) -> None:
        """Let the last command's reply come in."""

    @abstractmethod
    def until_seen(self, sign: Callable[[ArmState], bool]) -> None:
        """Let time pass, without a tick, until the arm's state shows `sign`."""

    # --- what the control loop asks and tells ---------------------------------------------------

    @property
    def ready(self) -> bool:
        return self.gate.ready

    def stop(self) -> None:
        self.gate.stop()

    @abstractmethod
    def request(self, request: ArmRequest) -> None: ...

    def age_ns(self, view: str, now_ns: int) -> int | None:
        return self._sight.age_ns(view, now_ns)

    def is_damaged(self, view: str) -> bool:
        return self._sight.is_damaged(view)

    def before_tick(self, now_ns: int) -> None:
        self.beats.append(now_ns)

    def receive(self, record: Record) -> None:
        if isinstance(record, Tick):
            self.ticks.append(record)
        elif isinstance(record, StopRecord):
            self.stops.append(record)
        elif isinstance(record, Note):
            self.notes.append(record.text)
        if self._recorder is not None:
            self._recorder.record(record)


def _fail(name: str, failure: BaseException) -> None:
    raise AssertionError(f"{name} failed") from failure
