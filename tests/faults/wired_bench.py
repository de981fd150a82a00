"""The bench over the wire: the real driver and SDK, and the controller model on TCP.

It makes about 120 ticks a second of real time. Time as the control loop and the driver see it goes
on by one period for each tick, however long the machine takes for it: a report is as many ticks old
as the loop has made since it came. The controller and every time-out on a socket live in real time.
"""

from __future__ import annotations

import itertools
import threading
import time
from collections.abc import Callable
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path

from hw.lite6.arm import Lite6
from hw.lite6.protocol import UxbusFrame
from hw.sim.controller.server import ControllerServer
from tams_app.config import load_config
from tams_app.records import ArmState, Record
from tams_app.robot.guarding import Guarding
from tams_app.runtime.worker import Worker
from tams_app.teleop.records import TeleopOutput
from tams_app.teleop.safety import Request as ArmRequest
from tams_app.units import NS_PER_S
from tests.faults.bench import ACROSS, PERIOD_NS, PERIOD_S, RATE_HZ, Bench, Pace
from tests.faults.wire import TappedModel, tapped_model

PATIENCE_S = 10.0  # real time, generous: the machine may be busy
REPLY_TIMEOUT_S = 0.3  # long enough for both ends to share one busy process
SIDEWAYS = 0.4 * ACROSS
_POLL_S = 0.001
_IN_STEP_S = 0.5
_FRESH_TICKS = 6


class TickClock:
    """Goes on by one control period per tick, and by a nanosecond whenever it is read."""

    def __init__(self) -> None:
        self._ticks_ns = NS_PER_S
        self._looks = itertools.count()

    def now_ns(self) -> int:
        return self._ticks_ns + next(self._looks)

    def sleep_until_ns(self, deadline_ns: int) -> None:
        while self.now_ns() < deadline_ns:
            time.sleep(_POLL_S)

    def suspended_ns(self) -> int:
        return 0

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
        self.is_mute: Callable[[UxbusFrame], bool] = lambda frame: False
        self.is_cut: Callable[[UxbusFrame], bool] = lambda frame: False

    def _answer(self, request: UxbusFrame, stop: threading.Event) -> bytes:
        if self.is_cut(request):
            raise ConnectionResetError("cut by the test")
        reply = super()._answer(request, stop)
        return b"" if self.is_mute(request) else reply


class WiredBench(Bench):
    """With a guard process beside it, if asked for."""

    pace = Pace(
        cruise=SIDEWAYS, cruise_s=20 * PERIOD_S, rest_s=20 * PERIOD_S, move_s=0.2, standing_ticks=10
    )
    in_flight = 1

    def __init__(self, folder: Path | None = None) -> None:
        with ExitStack() as opened:
            config, clock, model = load_config(), TickClock(), tapped_model()
            self.server = FaultyServer(model)
            self.server.start()
            opened.callback(self.server.close)
            ports = self.server.ports
            address = {
                "control_port": ports.control,
                "report_port": ports.report,
                "reply_timeout_s": REPLY_TIMEOUT_S,
            }
            arm_config = config.arm.model_copy(update=address)
            arm = Lite6(arm_config, clock, float(RATE_HZ))
            opened.callback(arm.close)
            arm.connect()
            wired = config.model_copy(update={"arm": arm_config})
            super().__init__(wired, clock, arm, model, folder)
            self._tick_clock = clock
            self._began_s = time.monotonic()
            self._began_ns = 0
            self.guarding: Guarding | None = None
            self.reachable = True  # set to False where no stop can reach the controller
            self.in_step = True  # set to False where replies are to be late
            self._fell_silent = False
            worker = Worker("arm-gate", self.gate.run)
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

    def add_guard(self) -> None:
        """Start the guard's process, with the product's limit, and let every tick beat it."""
        assert self.folder is not None
        guarding = Guarding(
            self.config.arm,
            self.config.limits,
            self.folder,
            self.signals,
            lambda level, text: self.notes.append(text),
        )
        self.cleaning.callback(guarding.close)
        guarding.start()
        guarding.wait_ready()
        self.guarding = guarding

    def stall(self, seconds: float) -> None:
        """Let time pass without a tick."""
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            time.sleep(PERIOD_S / 2)
            self._tick_clock.advance(PERIOD_NS // 2)

    def _let_pass(self, duration_ns: int) -> None:
        due_s = self._began_s + duration_ns / NS_PER_S
        time.sleep(max(0.0, due_s - time.monotonic()))
        self._began_s = time.monotonic()
        self._tick_clock.advance(duration_ns)
        self._began_ns = self.clock.now_ns()

    def _settle(self, output: TeleopOutput) -> None:
        if output.stop and self.reachable:
            tick = self.model.tick
            self.until(lambda: any(each.is_stop for each in self.requests(tick)))
        elif self.in_step and output.twist is not None:
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

    def until(self, condition: Callable[[], bool]) -> None:
        """Let real time pass, without a tick, until `condition` holds."""
        deadline_s = time.monotonic() + PATIENCE_S
        while not condition():
            assert time.monotonic() < deadline_s, f"not within {PATIENCE_S:g} s, {self.notes}"
            time.sleep(_POLL_S)

    # --- what the control loop asks and tells ---------------------------------------------------

    def request(self, request: ArmRequest) -> None:
        self.gate.request(request)

    def before_tick(self, now_ns: int) -> None:
        super().before_tick(now_ns)
        if self.guarding is not None:
            self.guarding.before_tick(now_ns)

    def receive(self, record: Record) -> None:
        if self.guarding is not None:  # first, as in a session
            self.guarding.receive(record)
        super().receive(record)


MakeBench = Callable[..., WiredBench]  # takes what its __init__ does
