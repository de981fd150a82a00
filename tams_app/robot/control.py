"""The control loop: 120 times a second from hand to arm, and from the arm to the phase."""

from __future__ import annotations

import threading
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

from hw.arm import Arm
from hw.controller import Controller
from tams_app.config import Config
from tams_app.policy.weights import WeightMatrix
from tams_app.records import (
    ArmState,
    CommandLink,
    ControllerSample,
    EpisodeRequest,
    Note,
    PinnedView,
    Record,
    Tick,
    TickInputs,
    Twist,
)
from tams_app.robot.arm_gate import ArmGate
from tams_app.robot.listener import Listener
from tams_app.runtime.clock import Clock, FixedRate, SleepWatch
from tams_app.teleop.records import TeleopInput, TeleopOutput, is_fresh
from tams_app.teleop.safety import Reason, Request
from tams_app.units import NS_PER_MS, NS_PER_S

if TYPE_CHECKING:
    from tams_app.policy.inference import Inference
    from tams_app.robot.homing import Homing
    from tams_app.robot.operator import Operator
    from tams_app.teleop.loop import Teleop

TOO_LONG_AGO = "not confirmed: the operator did so too long ago"
CONFIRMED_AGO_NS = 2 * NS_PER_S  # a confirmation that may be older is not acted on
_MOST_ASKED = 16  # between two ticks, or in a session that has no episodes
ENDLESS_NS = 1 << 62  # the age of video that shows nothing


@dataclass(frozen=True, slots=True)
class Pending:
    """The requests since the last tick, and the faults that stay until the session ends."""

    confirm: bool
    estop: bool
    faults: tuple[Reason, ...]
    late_confirm: bool = False  # one came that was given too long ago to count


class Signals:
    """Confirmations, emergency stops and faults: set from any thread, taken once per tick.

    What must not wait for a tick stops the arm as well, at once and over the driver's stop channel.
    """

    def __init__(self) -> None:
        self.pinned = ""  # view that the operator has pinned; "": none
        self._stop_arm: Callable[[], None] = lambda: None  # until there is a control loop
        self._confirmed_ns: int | None = None
        self._estop = False
        self._faults: dict[Reason, None] = {}
        self._trips: dict[Reason, None] = {}
        self._asked: deque[EpisodeRequest] = deque(maxlen=_MOST_ASKED)

    def episode(self, request: EpisodeRequest) -> None:
        """Something is asked about episodes, which moves and stops nothing."""
        self._asked.append(request)

    def episodes(self) -> list[EpisodeRequest]:
        """All that was asked since the last call."""
        return [self._asked.popleft() for _ in range(len(self._asked))]

    def confirm(self, asked_ns: int) -> None:
        """The operator agrees: arm, or clear a fault. They did so at `asked_ns` at the earliest."""
        self._confirmed_ns = asked_ns

    def stop_with(self, stop_arm: Callable[[], None]) -> None:
        """Set the function that stops the arm at once: from any thread, without blocking."""
        self._stop_arm = stop_arm

    def estop(self) -> None:
        """Emergency stop: of the arm at once, and a fault of the next tick."""
        self._estop = True  # first: a tick that sees the arm stopped knows why
        self._stop_arm()

    def fail(self) -> None:
        """The session has failed: stop the arm at once, and for good."""
        self.fault(Reason.SESSION_FAILED)
        self._stop_arm()

    def fault(self, reason: Reason) -> None:
        """Something the arm must not move without is gone, until the session ends."""
        self._faults[reason] = None  # one operation: two threads never lose one of two faults

    def trip(self, reason: Reason) -> None:
        """Something that stopped the arm once; the operator may confirm it away."""
        self._trips[reason] = None

    def take(self, now_ns: int) -> Pending:
        """Everything pending; confirmations and stops are used up by this.

        A confirmation is judged here, where it is used: whatever stood still on its way, it counts
        for `CONFIRMED_AGO_NS` from when the operator gave it.
        """
        trips, asked_ns = tuple(self._trips), self._confirmed_ns
        counts = asked_ns is not None and is_fresh(asked_ns, now_ns, CONFIRMED_AGO_NS)
        late = asked_ns is not None and not counts
        pending = Pending(counts, self._estop, (*self._faults, *trips), late)
        # only what was seen is used up: a stop that comes in between is taken by the next tick
        if self._confirmed_ns == asked_ns:
            self._confirmed_ns = None
        if pending.estop:
            self._estop = False
        for reason in trips:
            del self._trips[reason]
        return pending


class Observer(Protocol):
    """Draws conclusions from ticks; no thread, clock or file."""

    def step(self, inputs: TeleopInput, output: TeleopOutput) -> Sequence[Record]:
        """What follows from this tick, for the log and the listeners."""


@dataclass(frozen=True, slots=True)
class SteadyVideo:
    """The video of a loop that has none: every frame is shown at the same age."""

    delay_ns: int = 0

    def age_ns(self, view: str, now_ns: int) -> int:
        return self.delay_ns

    def is_damaged(self, view: str) -> bool:
        return False


@dataclass(frozen=True, slots=True)
class LoopDevices:
    """What the loop reads and commands; which frame counts: `station.fresh_video`."""

    controller: Controller
    arm: Arm
    gate: ArmGate
    video: Operator | SteadyVideo


class ControlLoop:
    """One tick: sample, step, send, infer the phase, record; the body of a Worker."""

    def __init__(
        self,
        config: Config,
        clock: Clock,
        devices: LoopDevices,
        signals: Signals,
        teleop: Teleop | Homing,
        inference: Inference,
        listeners: Sequence[Listener] = (),
        observers: Sequence[Observer] = (),
    ) -> None:
        """`build.control_loop` makes one with the configured teleoperation and inference."""
        self._clock = clock
        self._sleep = SleepWatch(clock)
        self._rate_hz = config.control.rate_hz
        self._controller, self._video = devices.controller, devices.video
        self._arm, self._gate = devices.arm, devices.gate
        self._signals = signals
        self._listeners, self._observers = tuple(listeners), tuple(observers)
        signals.stop_with(devices.gate.stop)
        self._teleop, self._phases = teleop, inference
        self._weights = WeightMatrix(config.policy.weights.matrix)
        self._pinned = ""
        # from the light to the capture time stamp, as calibrated; the rig's own cameras have none
        cameras = {} if config.rig.enabled else config.cameras
        self._camera_delays_ns = {
            view: round(camera.latency_ms * NS_PER_MS) for view, camera in cameras.items()
        }

    def run(self, stop: threading.Event) -> None:
        rate = FixedRate(self._clock, self._rate_hz)
        while not stop.is_set():
            due_ns = rate.wait()
            if stop.is_set():
                return  # the session's end is about to stop the arm: that is no fault
            self.tick(due_ns, rate.skipped)

    def tick(self, due_ns: int, skipped: int = 0) -> TeleopOutput:
        """One control period, due at `due_ns`."""
        now_ns = self._clock.now_ns()
        if self._sleep.slept():  # whatever lies in queues and memories is from before
            self._signals.trip(Reason.COMPUTER_SLEPT)
            for listener in self._listeners:
                listener.on_wake(now_ns)
        # received first: that the guard stopped the arm is the reason, what the arm reports follows
        for listener in self._listeners:
            listener.before_tick(now_ns)
        records: list[Record] = []
        sample = self._controller.sample(now_ns)
        if self._signals.pinned != self._pinned:
            self._pinned = self._signals.pinned
            records.append(PinnedView(now_ns, self._pinned))
        ready, arm, link = self._gate.ready, self._arm.state(), self._arm.link()
        pending = self._signals.take(now_ns)
        if pending.late_confirm:
            records.append(Note(now_ns, "warning", TOO_LONG_AGO))
        inputs = self._input(now_ns, sample, ready, arm, link, pending)
        output = self._teleop.step(inputs)
        self._act(output)
        if (change := self._phases.step(now_ns, arm)) is not None:
            records.append(change)
        follows = [one for each in self._observers for one in each.step(inputs, output)]
        finished_ns = self._clock.now_ns()
        records.append(tick_of(inputs, output, self._phases, due_ns, finished_ns, skipped))
        records.extend(follows)
        for record in records:
            for listener in self._listeners:
                listener.receive(record)
        return output

    def _input(
        self,
        now_ns: int,
        sample: ControllerSample,
        ready: bool,
        arm: ArmState | None,
        link: CommandLink,
        pending: Pending,
    ) -> TeleopInput:
        """`ready`, `arm`, `link` from before `pending`: who stops the arm signals it first."""
        view = self._weights.primary_view(self._phases.phase, self._pinned)
        age_ns = self._video.age_ns(view, now_ns)
        if age_ns is not None:
            age_ns += self._camera_delays_ns.get(view, 0)
        return TeleopInput(
            now_ns=now_ns,
            sample=sample,
            arm=arm,
            link=link,
            arm_ready=ready,
            video_age_ns=ENDLESS_NS if age_ns is None else age_ns,
            confirm=pending.confirm,
            estop=pending.estop,
            faults=pending.faults,
            video_damaged=self._video.is_damaged(view),
        )

    def _act(self, output: TeleopOutput) -> None:
        if output.stop:  # ends every motion; a zero twist would only queue up behind it
            self._gate.stop()
        elif output.twist is not None:
            self._arm.send_twist(output.twist)
        if output.gripper is not None:
            self._arm.set_gripper(output.gripper)
        if output.haptic is not None:
            self._controller.pulse(output.haptic)
        if output.request is not Request.NONE:
            self._gate.request(output.request)


def tick_of(
    inputs: TeleopInput,
    output: TeleopOutput,
    phases: Inference,
    due_ns: int,
    finished_ns: int,
    skipped: int,
) -> Tick:
    """The tick as it is logged."""
    return Tick(
        due_ns=due_ns,
        started_ns=inputs.now_ns,
        finished_ns=finished_ns,
        skipped=skipped,
        arming=output.arming.value,
        reason=describe(output),
        deadman=output.deadman,
        orientation_mode=output.orientation_mode,
        phase=phases.phase,
        speed=phases.speed,
        vertical_speed=phases.vertical_speed,
        speed_scale=output.speed_scale,
        twist=output.twist or Twist.zero(),
        controller=inputs.sample,
        arm=inputs.arm,
        link=inputs.link,
        gripper=output.gripper,
        stop=output.stop,
        inputs=TickInputs(
            inputs.arm_ready,
            inputs.video_age_ns,
            inputs.confirm,
            inputs.estop,
            tuple(fault.label for fault in inputs.faults),
            inputs.video_damaged,
        ),
        lasting=lasting_label(output),
    )


def lasting_label(output: TeleopOutput) -> str:
    """Of the reason whose cause is still there; "": it is gone."""
    return "" if output.lasting is None else output.lasting.label


def describe(output: TeleopOutput) -> str:
    """The reason why the arm does not move, label and detail; "" if nothing holds it."""
    if output.reason is None:
        return ""
    return f"{output.reason.label}: {output.detail}" if output.detail else output.reason.label
