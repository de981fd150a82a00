"""One tick of teleoperation: hand, arm and frame in, command and arming out."""

from __future__ import annotations

from tams_app.config import Config
from tams_app.records import Activity, ArmKinematics, Haptic, Twist
from tams_app.rotation import Rotation
from tams_app.teleop.clutch import Buttons, Clutch
from tams_app.teleop.drive import Drive
from tams_app.teleop.records import Refusal, TeleopInput, TeleopOutput
from tams_app.teleop.safety import (
    Arming,
    ArmingEvents,
    ArmingState,
    Reason,
    Request,
)
from tams_app.teleop.trajectory import TrajectoryError
from tams_app.teleop.watch import Watch
from tams_app.units import NS_PER_S

_TOLD_BY_THE_LINK = (Reason.ARM_LINK_LOST, Reason.ARM_REFUSES, Reason.GRIPPER_FAILED)
_PRECEDENCE = {reason: rank for rank, reason in enumerate(Reason)}


class Teleop:
    """From the operator's hand to the arm's command, one `step` per control period.

    The menu button: while the arm is armed (ready, engaged, holding) its press is an emergency
    stop at once. While it is disarmed or in fault, held 1 s it confirms; released sooner it is
    an emergency stop. A press that stopped the arm never confirms, however long it lasts.

    The gripper moves on the edges of A and B while engaged and never otherwise; a button that was
    down before engaging does nothing.
    """

    def __init__(
        self, config: Config, model: ArmKinematics, ready: Rotation, video_floor_ns: int = 0
    ) -> None:
        """`ready`: TCP rotation at the ready pose, the axis of the rotation cone.

        `video_floor_ns`: one-way latency plus jitter buffer of the primary view; the frame's age
        never slows or holds the arm below three times that.
        """
        self._clutch = Clutch(config.freshness.buttons_ms * 1e6)
        self._watch = Watch(config, video_floor_ns)
        self._drive = Drive(config, model, ready)
        self._arming = Arming()
        self._stall_s = config.arm.velocity_deadman_s
        self._last_ns: int | None = None
        self._menu_is_void = False
        self._fault_ns: int | None = None  # since then the arm has not yet reported that it stopped

    def step(self, tick: TeleopInput) -> TeleopOutput:
        """Take one tick in; never raises for what a device or an operator may do."""
        interval_s = self._interval(tick.now_ns)
        buttons = self._clutch.update(tick.sample, tick.now_ns)
        before = self._arming.state
        self._drive.note_interval(tick.now_ns, interval_s)
        faults, holds = self._judge(tick, buttons, interval_s)
        confirm = tick.confirm or (buttons.menu_hold and not self._menu_is_void)
        request = self._arming.step(
            ArmingEvents(
                now_ns=tick.now_ns,
                faults=faults,
                holds=holds,
                arm_ready=tick.arm_ready and self._watch.servo_ready(tick.arm),
                confirm=confirm,
                press=buttons.press,
                pressed=buttons.pressed,
                released=buttons.released,
            )
        )
        counts = request is not Request.NONE or self._arming.state is not before
        refusal = self._refusal() if confirm and not counts else None
        scale = self._watch.video_scale(tick.video_age_ns)
        try:
            self._move(tick, buttons, before, scale, interval_s)
        except TrajectoryError:
            self._arming.trip(Reason.TRAJECTORY_ERROR)
            self._drive.reset()
        return self._output(tick, buttons, before, faults, request, scale, refusal)

    def _interval(self, now_ns: int) -> float:
        """Seconds since the last tick; 0 at the first and if time went back."""
        last_ns, self._last_ns = self._last_ns, now_ns
        return 0.0 if last_ns is None else max(0, now_ns - last_ns) / NS_PER_S

    def _judge(
        self, tick: TeleopInput, buttons: Buttons, interval_s: float
    ) -> tuple[tuple[Reason, ...], tuple[Reason, ...]]:
        """Faults and holds of this tick, most important first."""
        state = self._arming.state
        faults = self._watch.faults(tick, state)
        holds = self._watch.holds(tick, state)
        if tick.estop or self._menu_stops(buttons):
            faults.append(Reason.EMERGENCY_STOP)
        if state is ArmingState.ENGAGED:
            if tick.arm is not None and Reason.ARM_STATE_INVALID not in holds:
                self._drive.observe(tick.arm)
            if self._drive.fault is not None:
                faults.append(self._drive.fault)
            if self._drive.hold is not None:
                holds.append(self._drive.hold)
            if interval_s > self._stall_s:
                holds.append(Reason.CONTROL_STALLED)
        return _ranked(faults), _ranked(holds)

    def _menu_stops(self, buttons: Buttons) -> bool:
        if self._arming.state.is_armed:
            self._menu_is_void = self._menu_is_void or buttons.menu_down
            return buttons.menu_down or buttons.menu_click
        if buttons.menu_down:
            self._menu_is_void = False
        return buttons.menu_click and not self._menu_is_void

    def _move(
        self,
        tick: TeleopInput,
        buttons: Buttons,
        before: ArmingState,
        scale: float,
        interval_s: float,
    ) -> None:
        state = self._arming.state
        if not state.is_armed:
            self._drive.reset()
            return
        if interval_s > self._stall_s:
            self._drive.halt()
        if state is not before and state is ArmingState.ENGAGED:
            self._drive.engage()
        if buttons.toggle_mode:
            self._drive.toggle_mode()
        if state is ArmingState.ENGAGED and tick.arm is not None:  # whose report no hold doubts
            self._drive.follow(
                tick.sample, tick.arm, tick.link.round_trip_ns, scale, tick.now_ns, interval_s
            )
        else:
            self._drive.rest(interval_s)

    def _output(
        self,
        tick: TeleopInput,
        buttons: Buttons,
        before: ArmingState,
        faults: tuple[Reason, ...],
        request: Request,
        scale: float,
        refusal: Refusal | None,
    ) -> TeleopOutput:
        state = self._arming.state
        twist = None
        if state.is_armed:
            twist = self._drive.twist
        elif state is ArmingState.FAULT and before.is_armed:
            twist = Twist.zero()
        gripper = None
        if state is ArmingState.ENGAGED and (buttons.close_gripper or buttons.open_gripper):
            gripper = buttons.close_gripper
        return TeleopOutput(
            twist=twist,
            gripper=gripper,
            stop=self._must_stop(tick, before, faults),
            request=request,
            arming=state,
            reason=self._arming.reason,
            detail=self._detail(tick),
            deadman=buttons.pressed,
            orientation_mode=self._drive.orientation_mode,
            speed_scale=scale * self._drive.joint_scale,
            braking=self._drive.braking,
            haptic=_haptic(before, state, self._arming.reason),
            refusal=refusal,
            lasting=self._arming.lasting,
        )

    def _refusal(self) -> Refusal | None:
        """The reason that a confirmation does not count; None where there is nothing to confirm."""
        arming = self._arming
        if arming.state.is_armed:
            return None
        in_fault = arming.state is ArmingState.FAULT
        return Refusal(arming.blocked_by if in_fault else arming.reason)

    def _must_stop(
        self, tick: TeleopInput, before: ArmingState, faults: tuple[Reason, ...]
    ) -> bool:
        """From a fault or an emergency stop until a later report says that the arm stopped."""
        if self._arming.state is not ArmingState.FAULT:
            self._fault_ns = None
            return False
        if before is not ArmingState.FAULT or Reason.EMERGENCY_STOP in faults:
            self._fault_ns = tick.now_ns
        elif self._fault_ns is not None and tick.arm is not None:
            stopped = tick.arm.activity is Activity.STOPPED
            if stopped and tick.arm.received_ns > self._fault_ns:
                self._fault_ns = None
        return self._fault_ns is not None

    def _detail(self, tick: TeleopInput) -> str:
        reason, blocked_by = self._arming.reason, self._arming.blocked_by
        sentences = []
        # the state that follows from an error may be reported before the error itself
        told_by_the_arm = reason in (Reason.ARM_ERROR, Reason.ARM_STOPPED)
        if told_by_the_arm and tick.arm is not None and tick.arm.fault is not None:
            sentences.append(tick.arm.fault.text)
        elif reason in _TOLD_BY_THE_LINK and tick.link.failure:
            sentences.append(tick.link.failure)
        if blocked_by is not None and blocked_by is not reason:
            sentences = [one.removesuffix(".") for one in sentences]
            sentences.append(f"and {blocked_by.label}")
        return ", ".join(sentences)


def _ranked(reasons: list[Reason]) -> tuple[Reason, ...]:
    return tuple(sorted(reasons, key=_PRECEDENCE.__getitem__))


def _haptic(before: ArmingState, state: ArmingState, reason: Reason | None) -> Haptic | None:
    if state is before:
        return None
    if state is ArmingState.FAULT:
        return Haptic.LINK_FAULT if reason is Reason.LINK_LOST else Haptic.FAULT
    if state is ArmingState.HOLDING:
        by_link = reason in (Reason.LINK_GAP, Reason.LINK_GAPS)
        return Haptic.LINK_HOLD if by_link else Haptic.LIMIT
    if state is ArmingState.ENGAGED:
        return Haptic.ENGAGE
    return Haptic.RELEASE if before is ArmingState.ENGAGED else None
