"""The control thread: 120 times a second from hand to arm, and from the arm to the phase."""

from __future__ import annotations

import threading
from collections.abc import Callable
from dataclasses import dataclass

from hw.arm import Arm
from hw.controller import Controller
from tams_app.policy.phases import PhaseDecision, PhaseTracker
from tams_app.policy.tcp_speed import SmoothedSpeed
from tams_app.records import (
    ArmState,
    CommandLink,
    ControllerSample,
    Phase,
    PhaseChange,
    Tick,
    Twist,
)
from tams_app.runtime.clock import NS_PER_S, Clock, FixedRate
from tams_app.session.signals import Signals
from tams_app.teleop.loop import Teleop
from tams_app.teleop.records import TeleopInput, TeleopOutput
from tams_app.teleop.safety import Request


@dataclass(frozen=True, slots=True)
class ControlHooks:
    """What the session wants to know of each tick; none of these may block."""

    beat: Callable[[int], None]  # the guard's heartbeat; what it brings is a signal of this tick
    video_age_ns: Callable[[int, Phase], int | None]  # of the shown primary view
    stop: Callable[[], None]  # the arm, now
    request: Callable[[Request], None]  # enable the arm, clear its errors
    arm_ready: Callable[[], bool]
    phase_began: Callable[[PhaseChange], None]
    record: Callable[[Tick], None]
    output: Callable[[int, TeleopOutput, ArmState | None], None]


class ControlLoop:
    """One tick: sample, step, send, infer the phase, record; the body of a Worker."""

    def __init__(
        self,
        clock: Clock,
        rate_hz: float,
        controller: Controller,
        arm: Arm,
        teleop: Teleop,
        tracker: PhaseTracker,
        smoothed: SmoothedSpeed,
        signals: Signals,
        hooks: ControlHooks,
    ) -> None:
        self._clock = clock
        self._rate_hz = rate_hz
        self._controller = controller
        self._arm = arm
        self._teleop = teleop
        self._tracker = tracker
        self._smoothed = smoothed
        self._signals = signals
        self._hooks = hooks
        self._last_ns: int | None = None

    def run(self, stop: threading.Event) -> None:
        rate = FixedRate(self._clock, self._rate_hz)
        while not stop.is_set():
            due_ns = rate.wait()
            if stop.is_set():
                return  # whoever asked is about to stop the arm: that is no fault
            self.tick(due_ns, rate.skipped)

    def tick(self, due_ns: int, skipped: int = 0) -> TeleopOutput:
        """One control period, due at `due_ns`."""
        now_ns = self._clock.now_ns()
        # heard first: that the guard stopped the arm is the reason, what the arm reports follows
        self._hooks.beat(now_ns)
        sample = self._controller.sample(now_ns)
        arm, link = self._arm.state(), self._arm.link()
        output = self._teleop.step(self._input(now_ns, sample, arm, link))
        self._act(output)
        phase = self._infer_phase(now_ns, arm).phase
        self._hooks.output(now_ns, output, arm)
        self._hooks.record(
            Tick(
                due_ns=due_ns,
                started_ns=now_ns,
                finished_ns=self._clock.now_ns(),
                skipped=skipped,
                arming=output.arming.value,
                reason=describe(output),
                deadman=output.deadman,
                orientation_mode=output.orientation_mode,
                phase=phase,
                speed=self._smoothed.speed,
                vertical_speed=self._smoothed.vertical_speed,
                speed_scale=output.speed_scale,
                twist=output.twist or Twist.zero(),
                controller=sample,
                arm=arm,
                link=link,
            )
        )
        return output

    def _input(
        self, now_ns: int, sample: ControllerSample, arm: ArmState | None, link: CommandLink
    ) -> TeleopInput:
        pending = self._signals.take()
        return TeleopInput(
            now_ns=now_ns,
            sample=sample,
            arm=arm,
            link=link,
            arm_ready=self._hooks.arm_ready(),
            video_age_ns=self._hooks.video_age_ns(now_ns, self._tracker.phase),
            confirm=pending.confirm,
            estop=pending.estop,
            faults=pending.faults,
        )

    def _act(self, output: TeleopOutput) -> None:
        if output.stop:  # ends every motion; a zero twist would only queue up behind it
            self._hooks.stop()
        elif output.twist is not None:
            self._arm.send_twist(output.twist)
        elif output.pose is not None:
            self._arm.send_pose(output.pose)
        if output.gripper is not None:
            self._arm.set_gripper(output.gripper)
        if output.haptic is not None:
            self._controller.pulse(output.haptic)
        if output.request is not Request.NONE:
            self._hooks.request(output.request)

    def _infer_phase(self, now_ns: int, arm: ArmState | None) -> PhaseDecision:
        period_s = 0.0 if self._last_ns is None else (now_ns - self._last_ns) / NS_PER_S
        self._last_ns = now_ns
        if arm is not None:
            self._smoothed.update(arm.tcp.position, arm.received_ns)
        before = self._tracker.phase
        decision = self._tracker.step(
            speed=self._smoothed.speed,
            vertical_speed=self._smoothed.vertical_speed,
            closed=arm.gripper_closed if arm is not None else None,
            period_s=period_s,
        )
        if decision.phase is not before:
            self._hooks.phase_began(PhaseChange(now_ns, decision.phase, decision.reason))
        return decision


def describe(output: TeleopOutput) -> str:
    """Why the arm does not move, "" if nothing holds it: the reason's label and its detail."""
    if output.reason is None:
        return ""
    return f"{output.reason.label}: {output.detail}" if output.detail else output.reason.label
