"""The reasons to stop that hold right now: something is lost, stale or out of order."""

from __future__ import annotations

import math

from tams_app.config import Config
from tams_app.records import ArmState, ControllerSample, ControllerStatus, LinkFault, ServoMode
from tams_app.teleop.motion import is_frozen
from tams_app.teleop.records import TeleopInput, is_fresh
from tams_app.teleop.safety import ArmingState, Reason
from tams_app.units import NS_PER_MS, NS_PER_S

ARM_SILENT_NS = NS_PER_S
_VIDEO_FLOOR_FACTOR = 3
_MOST_SANE = 100.0  # [m, rad]: nothing tracked or reported is that far away

_LOST = {
    ControllerStatus.LINK_LOST: Reason.LINK_LOST,
    ControllerStatus.OPERATOR_AWAY: Reason.OPERATOR_LEFT,
    ControllerStatus.DISCONNECTED: Reason.CONTROLLER_DISCONNECTED,
    ControllerStatus.RUNTIME_QUIT: Reason.RUNTIME_QUIT,
    ControllerStatus.ROLE_SWAPPED: Reason.ROLE_SWAPPED,
    ControllerStatus.TRACKING_FRAME_CHANGED: Reason.TRACKING_FRAME_CHANGED,
}
_LINK_FAULTS = {
    LinkFault.LOST: Reason.ARM_LINK_LOST,
    LinkFault.REFUSED: Reason.ARM_REFUSES,
    LinkFault.GRIPPER: Reason.GRIPPER_FAILED,
}
_AWAY = {
    ControllerStatus.TRACKING_LOST: Reason.TRACKING_LOST,
    ControllerStatus.STANDBY: Reason.CONTROLLER_STANDBY,
    ControllerStatus.DASHBOARD: Reason.DASHBOARD_OPEN,
    ControllerStatus.LINK_GAP: Reason.LINK_GAP,
    ControllerStatus.LINK_GAPS: Reason.LINK_GAPS,
}
# A disarmed arm needs no operator.
_NO_OPERATOR = (ControllerStatus.LINK_LOST, ControllerStatus.OPERATOR_AWAY)


class Watch:
    """Judges one tick's input by itself; what needs memory is judged where the memory is."""

    def __init__(self, config: Config, video_floor_ns: int) -> None:
        fresh = config.freshness
        floor_ns = _VIDEO_FLOOR_FACTOR * video_floor_ns
        self._fresh = fresh
        self._video_slow_ns = max(fresh.video_slow_ms * NS_PER_MS, floor_ns)
        self._video_hold_ns = max(fresh.video_hold_ms * NS_PER_MS, floor_ns)

    def faults(self, tick: TeleopInput, state: ArmingState) -> list[Reason]:
        """Faults that hold now, beside what the session reports in `tick.faults`."""
        found = [reason for reason in tick.faults if reason.is_fault]
        if tick.sample.status in _LOST:
            if not _is_merely_away(tick.sample, state):
                found.append(_LOST[tick.sample.status])
        elif state is ArmingState.ENGAGED and self._pose_is_frozen(tick):
            found.append(Reason.POSE_FROZEN)
        if tick.link.failure:
            found.append(_LINK_FAULTS.get(tick.link.fault, Reason.ARM_LINK_LOST))
        if tick.arm is not None:
            found += self._arm_faults(tick.arm, tick.now_ns, state)
        return found

    def holds(self, tick: TeleopInput, state: ArmingState) -> list[Reason]:
        """Holds that apply now, beside what the session reports in `tick.faults`."""
        found = [reason for reason in tick.faults if not reason.is_fault]
        if _is_merely_away(tick.sample, state):
            found.append(Reason.NO_OPERATOR)
        found += self._sample_holds(tick.sample, tick.now_ns)
        if state is ArmingState.READY and self._pose_is_frozen(tick):
            found.append(Reason.POSE_FROZEN)  # engaging would be a fault at once
        found += self._arm_holds(tick, state)
        if state.is_armed and self.video_scale(tick.video_age_ns) <= 0.0:
            found.append(Reason.VIDEO_DAMAGED if tick.video_damaged else Reason.STALE_VIDEO)
        return found

    def servo_ready(self, arm: ArmState | None) -> bool:
        """Whether the arm reports the velocity servo and a state in which it follows commands."""
        return arm is not None and arm.servo is ServoMode.VELOCITY and not arm.activity.is_halted

    def video_scale(self, age_ns: int | None) -> float:
        """1 for a fresh frame, falling to 0 at the age at which the arm holds; None: no video.

        0 for one more than 50 ms ahead as well: its stamp says nothing about its age.
        """
        if age_ns is None:
            return 1.0
        if not is_fresh(-age_ns, 0, self._video_hold_ns - 1):
            return 0.0
        if age_ns < self._video_slow_ns:
            return 1.0
        return (self._video_hold_ns - age_ns) / (self._video_hold_ns - self._video_slow_ns)

    def _pose_is_frozen(self, tick: TeleopInput) -> bool:
        # Without a pose the tracking is lost, which is a reason of its own.
        if tick.sample.status is not ControllerStatus.OK or tick.sample.pose is None:
            return False
        return is_frozen(tick.sample, tick.now_ns, self._fresh.pose_frozen_ms)

    def _arm_faults(self, arm: ArmState, now_ns: int, state: ArmingState) -> list[Reason]:
        found = []
        if arm.fault is not None:
            found.append(Reason.ARM_ERROR)
        if now_ns - arm.received_ns > ARM_SILENT_NS:
            found.append(Reason.ARM_SILENT)
        if state.is_armed and arm.activity.is_halted:
            found.append(Reason.ARM_STOPPED)
        elif state.is_armed and arm.servo is not ServoMode.VELOCITY:
            found.append(Reason.ARM_MODE)
        return found

    def _sample_holds(self, sample: ControllerSample, now_ns: int) -> list[Reason]:
        if sample.status in _AWAY:
            return [_AWAY[sample.status]]
        if sample.status is not ControllerStatus.OK:
            return []  # a fault already
        found = []
        if sample.pose is None:
            found.append(Reason.TRACKING_LOST)
        elif not _is_sane(sample, now_ns):
            found.append(Reason.BAD_INPUT)
        if not is_fresh(sample.buttons_ns, now_ns, self._fresh.buttons_ms * NS_PER_MS):
            found.append(Reason.BUTTONS_STALE)
        return found

    def _arm_holds(self, tick: TeleopInput, state: ArmingState) -> list[Reason]:
        found = []
        if state.is_armed and not tick.arm_ready:
            found.append(Reason.ARM_NOT_READY)
        arm_limit_ns = self._fresh.arm_state_ms * NS_PER_MS
        if tick.arm is None or not is_fresh(tick.arm.received_ns, tick.now_ns, arm_limit_ns):
            found.append(Reason.ARM_STATE_STALE)
        elif not _is_sane_arm(tick.arm):
            found.append(Reason.ARM_STATE_INVALID)
        # Disarmed, nothing is sent that could be answered.
        reply_limit_ns = self._fresh.arm_reply_ms * NS_PER_MS
        waited_ns = max(tick.now_ns - tick.link.acknowledged_ns, tick.link.round_trip_ns)
        if state.is_armed and waited_ns > reply_limit_ns:
            found.append(Reason.ARM_REPLY_LATE)
        return found


def _is_merely_away(sample: ControllerSample, state: ArmingState) -> bool:
    """True if no operator is there while the arm is disarmed."""
    return state is ArmingState.DISARMED and sample.status in _NO_OPERATOR


def _is_sane(sample: ControllerSample, now_ns: int) -> bool:
    if sample.pose is None or not is_fresh(sample.pose_ns, now_ns, float("inf")):
        return False
    position, rotation = sample.pose.position.tolist(), sample.pose.rotation
    return _are_sane((*position, *rotation, sample.trigger, sample.grip))


def _is_sane_arm(arm: ArmState) -> bool:
    return _are_sane((*arm.joints.tolist(), *arm.tcp.position.tolist(), *arm.tcp.rotation))


def _are_sane(values: tuple[float, ...]) -> bool:
    """Finite, and not so large that arithmetic could overflow."""
    return all(map(math.isfinite, values)) and max(map(abs, values)) <= _MOST_SANE
