"""The control loop against the arm's controller: the real driver over TCP, or in virtual time.

Ticks are counted, from 0. Live, time as the control loop and the driver see it goes on by one
period for each tick, however long the machine takes for it: a report is as many ticks old as the
loop has made since it came. The controller and every time-out on a socket live in real time.
"""

from __future__ import annotations

import itertools
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack, nullcontext
from pathlib import Path

import numpy as np

from hw.arm import Arm
from hw.boundary import session_boundary
from hw.lite6 import Lite6
from hw.lite6_kinematics import Lite6Model, offset_from_mm_deg
from hw.sim.controller_server import ControllerServer
from hw.sim.controller_wire import Frame
from hw.sim.inprocess_arm import InProcessArm
from hw.sim.plant import IdealPlant
from tams_app.clock import NS_PER_S, Clock, VirtualClock
from tams_app.config import ArmConfig, Config
from tams_app.config.motion import GuardConfig
from tams_app.recording import SessionLog, read_log
from tams_app.records import ArmState, PhaseChange, StopRecord, Tick, Vector
from tams_app.session import build
from tams_app.session.control import ControlHooks, ControlLoop
from tams_app.session.guarding import Guarding
from tams_app.session.recorders import LOG_NAME, Recorders
from tams_app.session.signals import Signals
from tams_app.session.stops import StopWatch
from tams_app.session.supervisor import ArmSupervisor
from tams_app.teleop.records import TeleopOutput
from tams_app.teleop.safety import ArmingState
from tams_app.teleop.safety import Request as ArmRequest
from tams_app.video.repair import repair_rule
from tams_app.worker import Worker

from .bench import PERIOD_NS, PERIOD_S, RATE_HZ, Hand
from .wire import Request, TappedModel

PATIENCE_S = 10.0  # real time, generous: the machine may be busy
SIDEWAYS = np.array([0.0, 0.1, 0.0])
_POLL_S = 0.001
_IN_STEP_S = 0.5
_FRESH_TICKS = 6
_PICTURE_AGE_NS = 60_000_000
_NETWORK = "s2"


class TickClock:
    """Goes on by one control period per tick, and by a nanosecond whenever somebody looks."""

    def __init__(self) -> None:
        self._ticks_ns = NS_PER_S
        self._looks = itertools.count()

    def now_ns(self) -> int:
        return self._ticks_ns + next(self._looks)

    def sleep_until_ns(self, deadline_ns: int) -> None:
        while self.now_ns() < deadline_ns:
            time.sleep(_POLL_S)

    def advance(self, duration_ns: int = PERIOD_NS) -> None:
        """One tick later."""
        self._ticks_ns += duration_ns


class FaultyServer(ControllerServer):
    """The controller on TCP, with a bad cable.

    A request for which `is_mute` holds is done and never answered; one for which `is_cut` holds
    ends its connection.
    """

    def __init__(self, model: TappedModel) -> None:
        super().__init__(model)
        self.is_mute: Callable[[Frame], bool] = lambda frame: False
        self.is_cut: Callable[[Frame], bool] = lambda frame: False

    def _answer(self, request: Frame, stop: threading.Event) -> bytes:
        if self.is_cut(request):
            raise ConnectionResetError("cut by the test")
        reply = super()._answer(request, stop)
        return b"" if self.is_mute(request) else reply


def tapped_model(firmware: str = "2.6.0") -> TappedModel:
    """The controller of an arm at the ready pose."""
    joints = np.radians(np.array(ArmConfig().ready_joints_deg))
    return TappedModel(IdealPlant(), start_joints=joints, firmware=firmware)


class ArmBench(ABC):
    """Hand, arm and controller at the test's disposal; `tick` and `run` move time."""

    def __init__(
        self, config: Config, clock: Clock, arm: Arm, model: TappedModel, folder: Path | None
    ) -> None:
        """With a `folder` everything goes into a log there; see `read_back`. Connects the arm."""
        self.config, self.clock, self.arm, self.model = config, clock, arm, model
        self.hand = Hand(config)
        self._kinematics = Lite6Model(offset_from_mm_deg(config.arm.tcp_offset_mm_deg))
        self.signals = Signals()
        self.guarding: Guarding | None = None
        self.notes: list[str] = []
        self.ticks: list[Tick] = []
        self.outputs: list[TeleopOutput] = []
        self.positions: list[Vector] = []  # of the TCP as it truly is, at the end of each tick
        self.supervisor = ArmSupervisor(
            arm, build.servo(config), session_boundary(config.arm, config.limits), self._note
        )
        self._cleaning = ExitStack()
        self._folder = folder
        self._recorders: Recorders | None = None
        if folder is not None:
            self._recorders = Recorders(config, clock, folder, _fail)
            self._cleaning.callback(self._recorders.close)
        self._stop_watch = StopWatch(self._keep)
        network = config.networks[_NETWORK]
        self.loop = ControlLoop(
            clock,
            float(RATE_HZ),
            self.hand,
            arm,
            build.teleop(config, build.picture_delay_ns(network, repair_rule(network, 300.0))),
            build.phase_tracker(config),
            build.smoothed_speed(config),
            self.signals,
            ControlHooks(
                beat=self._beat,
                video_age_ns=lambda now_ns, phase: _PICTURE_AGE_NS,
                request=self._ask,
                arm_ready=lambda: self.supervisor.ready,
                phase_began=self._keep,
                record=self._keep_tick,
                output=self._observe,
            ),
        )
        self._cleaning.callback(arm.close)

    # --- time -----------------------------------------------------------------------------------

    def tick(self) -> TeleopOutput:
        """One tick of the control loop, a period after the last one."""
        self._let_a_period_pass()
        with self.lock:
            self.model.tick = self.next
        output = self.loop.tick(self.clock.now_ns())
        self.outputs.append(output)
        self._settle(output)
        self.positions.append(self.position)
        return output

    def run(self, ticks: int) -> TeleopOutput:
        """That many ticks; the last one's output."""
        for _ in range(ticks):
            output = self.tick()
        return output

    def run_until(self, condition: Callable[[TeleopOutput], bool], within: int = 1200) -> int:
        """Tick until `condition` holds for a tick's output; that tick's number."""
        for _ in range(within):
            if condition(self.tick()):
                return self.next - 1
        raise AssertionError(f"not within {within} ticks: {self.outputs[-1]}, notes {self.notes}")

    def run_until_state(self, state: ArmingState) -> int:
        """Tick until the arming is in `state`; that tick's number."""
        return self.run_until(lambda output: output.arming is state)

    @property
    def next(self) -> int:
        """The number of the tick to come: in it, what is visible now will be seen."""
        return len(self.outputs)

    # --- what an operator does ------------------------------------------------------------------

    def make_ready(self) -> None:
        """Confirm with the trigger up, until the arm is ready."""
        self.run(3)
        self.signals.confirm()
        self.run_until_state(ArmingState.READY)

    def engage_and_move(self, velocity: Vector = SIDEWAYS, ticks: int = 20) -> None:
        """From power-on to a steady motion with `velocity` [m/s]."""
        self.make_ready()
        self.hand.trigger = 1.0
        self.run_until_state(ArmingState.ENGAGED)
        self.run(2)
        self.hand.velocity = velocity
        self.run(ticks)
        assert self.outputs[-1].arming is ArmingState.ENGAGED, self.ticks[-1].reason
        assert self.travel_m(self.next - ticks) > 0.002, "the arm moves"

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

    def travel_m(self, first: int) -> float:
        """How far the TCP truly was, at most, from where it was before tick `first` [m]."""
        start = self.positions[first - 1]
        return max(float(np.linalg.norm(each - start)) for each in self.positions[first:])

    def first_seen(self, sign: Callable[[Tick], bool], since: int) -> int:
        """The first tick from `since` on whose input shows `sign`."""
        return next(number for number in range(since, self.next) if sign(self.ticks[number]))

    def read_back(self) -> SessionLog:
        """Close the log and read it."""
        assert self._recorders is not None
        assert self._folder is not None
        self._stop_watch.finish()
        self._recorders.close()
        return read_log(self._folder / LOG_NAME)

    def close(self) -> None:
        """Let go of everything."""
        self._cleaning.close()

    # --- how time passes ------------------------------------------------------------------------

    @abstractmethod
    def _let_a_period_pass(self) -> None: ...

    @abstractmethod
    def _settle(self, output: TeleopOutput) -> None:
        """Let what the tick asked for reach the wire: it belongs to this tick."""

    @abstractmethod
    def quiesce(self) -> None:
        """Let the last command's reply come in."""

    @abstractmethod
    def until_seen(self, sign: Callable[[ArmState], bool]) -> None:
        """Let time pass, without a tick, until the arm's state shows `sign`."""

    @abstractmethod
    def _ask(self, request: ArmRequest) -> None: ...

    # --- hooks of the control loop --------------------------------------------------------------

    def _beat(self, now_ns: int) -> None:
        if self.guarding is not None:
            self.guarding.beat(now_ns)

    def _observe(self, now_ns: int, output: TeleopOutput, arm: ArmState | None) -> None:
        if self.guarding is not None:  # as session.observer does
            self.guarding.follow(output.arming, output.stop)
        if output.stop:
            self.supervisor.stopped()
        self._stop_watch.observe(now_ns, output, arm)

    def _keep_tick(self, tick: Tick) -> None:
        self.ticks.append(tick)
        self._keep(tick)

    def _keep(self, record: Tick | StopRecord | PhaseChange) -> None:
        if self._recorders is not None:
            self._recorders.record(record)

    def _note(self, level: str, text: str) -> None:
        self.notes.append(text)


class VirtualBench(ArmBench):
    """The in-process arm in virtual time."""

    def __init__(self, config: Config, folder: Path | None = None) -> None:
        clock, model = VirtualClock(), tapped_model()
        self._arm = InProcessArm(config.arm, clock, model)
        self._stops = 0
        self._arm.connect()
        super().__init__(config, clock, self._arm, model, folder)

    @property
    def lock(self) -> AbstractContextManager[object]:
        return nullcontext()

    def _let_a_period_pass(self) -> None:
        self._arm.advance(PERIOD_NS)

    def _settle(self, output: TeleopOutput) -> None:
        self._stops += output.stop

    def quiesce(self) -> None:
        """Every reply is there at once."""

    def until_seen(self, sign: Callable[[ArmState], bool]) -> None:
        for _ in range(RATE_HZ):
            state = self.arm.state()
            if state is not None and sign(state):
                return
            self._arm.advance(PERIOD_NS // 4)
        raise AssertionError("the arm does not report it")

    def _ask(self, request: ArmRequest) -> None:
        self.supervisor.request(request)
        self.supervisor.carry_out(request, self._stops)


class LiveBench(ArmBench):
    """The real driver and SDK over TCP, at about 120 ticks a second of real time."""

    def __init__(
        self, config: Config, folder: Path | None = None, reply_timeout_s: float = 0.3
    ) -> None:
        """`reply_timeout_s`: long enough for both ends to share one busy process."""
        with ExitStack() as opened:
            clock, model = TickClock(), tapped_model()
            self.server = FaultyServer(model)
            self.server.start()
            opened.callback(self.server.close)
            ports = self.server.ports
            address = {
                "control_port": ports.control,
                "report_port": ports.report,
                "reply_timeout_s": reply_timeout_s,
            }
            arm_config = config.arm.model_copy(update=address)
            arm = Lite6(arm_config, clock, float(RATE_HZ))
            opened.callback(arm.close)
            arm.connect()
            live = config.model_copy(update={"arm": arm_config})
            super().__init__(live, clock, arm, model, folder)
            self._tick_clock = clock
            self._began_s = time.monotonic()
            self._began_ns = 0
            self.longest_gap_s = 0.0  # of real time between two ticks
            self.reachable = True  # set to False where no stop can reach the controller
            self.in_step = True  # set to False where replies are to be late
            self._fell_silent = False
            worker = Worker("arm-supervisor", self.supervisor.run)
            worker.start()
            opened.callback(worker.stop, PATIENCE_S)
            self._server_side = opened.pop_all()

    @property
    def lock(self) -> AbstractContextManager[object]:
        return self.server.lock

    def close(self) -> None:
        with ExitStack() as stack:
            stack.callback(self._server_side.close)
            stack.callback(super().close)

    def add_guard(self, heartbeat_timeout_ms: float) -> None:
        """Start the guard's process and let every tick beat it."""
        assert self._folder is not None
        guard = GuardConfig(heartbeat_timeout_ms=heartbeat_timeout_ms)
        arm = self.config.arm.model_copy(update={"guard": guard})
        guarding = Guarding(arm, self._folder, self.signals, self._note)
        self._cleaning.callback(guarding.close)
        guarding.start()
        guarding.wait_ready()
        self.guarding = guarding

    def stall(self, seconds: float) -> float:
        """Let time pass without a tick; how long it really took."""
        began_s = time.monotonic()
        while (elapsed_s := time.monotonic() - began_s) < seconds:
            time.sleep(PERIOD_S / 2)
            self._tick_clock.advance(PERIOD_NS // 2)
        return elapsed_s

    def _let_a_period_pass(self) -> None:
        time.sleep(max(0.0, self._began_s + PERIOD_S - time.monotonic()))
        began_s = time.monotonic()
        self.longest_gap_s = max(self.longest_gap_s, began_s - self._began_s)
        self._began_s = began_s
        self._tick_clock.advance()
        self._began_ns = self.clock.now_ns()

    def _settle(self, output: TeleopOutput) -> None:
        if output.stop and self.reachable:
            tick = self.model.tick
            self.until(lambda: any(each.is_stop for each in self.requests(tick)))
        elif self.in_step and (output.twist is not None or output.pose is not None):
            self._await_arm()

    def _await_arm(self) -> None:
        """On a busy machine the arm's threads fall behind: wait for them, unless it is a fault."""
        deadline_s = time.monotonic() + (0.0 if self._fell_silent else _IN_STEP_S)
        while not (follows := self._follows()) and time.monotonic() < deadline_s:
            time.sleep(_POLL_S)
        self._fell_silent = not follows

    def _follows(self) -> bool:
        """Whether the last command was answered and the reports are fresh."""
        state = self.arm.state()
        fresh_ns = self._began_ns - _FRESH_TICKS * PERIOD_NS
        answered = self.arm.link().acknowledged_ns > self._began_ns
        return answered and state is not None and state.received_ns > fresh_ns

    def quiesce(self) -> None:
        self.until(lambda: self.arm.link().acknowledged_ns > self._began_ns)

    def until_seen(self, sign: Callable[[ArmState], bool]) -> None:
        def seen() -> bool:
            state = self.arm.state()
            return state is not None and sign(state)

        self.until(seen)

    def _ask(self, request: ArmRequest) -> None:
        self.supervisor.request(request)

    def until(self, condition: Callable[[], bool]) -> None:
        """Let real time pass, without a tick, until `condition` holds."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline_s, f"not within {PATIENCE_S:g} s, {self.notes}"
            time.sleep(_POLL_S)


MakeBench = Callable[..., LiveBench]  # servo and what else its __init__ takes


def _fail(name: str, failure: BaseException) -> None:
    raise AssertionError(f"{name} failed") from failure
