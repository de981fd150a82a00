"""The decisions of moving to the ready pose, which happens only while the operator holds a key.

Pure, and in the place of `teleop.loop.Teleop` in the control loop: what a session stops for is
judged by the session's own rules; here are the path, the held key and the order of a start.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from enum import StrEnum

import numpy as np

from hw.arms import arm_kind
from tams_app.config import Config
from tams_app.errors import DeviceError
from tams_app.records import Activity, ArmState, Vector
from tams_app.teleop.hands import HANDS
from tams_app.teleop.records import TeleopInput, TeleopOutput
from tams_app.teleop.safety import ArmingState, Reason, Request
from tams_app.teleop.watch import Watch
from tams_app.units import NS_PER_MS, NS_PER_S

# A key that is held repeats: after up to 0.66 s (X11's default), then every 25 to 100 ms.
FIRST_REPEAT_NS = 700 * NS_PER_MS
REPEAT_NS = 250 * NS_PER_MS
HOLD_NS = 300 * NS_PER_MS  # of repeats: some quick taps are no held key

ARRIVED_RAD = 0.005
OFF_PATH_RAD = math.radians(2.0)  # further from the path that was shown, it is another one
NO_MOTION_NS = NS_PER_S  # a controller that stands still for so long has given up
_SAMPLES = 100
_FLOOR_TOLERANCE_M = 0.001

_STANDS_STILL = "The arm stands still on its path; look for what holds it."
_TOLD_BY_THE_LINK = (Reason.ARM_LINK_LOST, Reason.ARM_REFUSES, Reason.GRIPPER_FAILED)
_WORDS = replace(HANDS["keyboard"], release="start again")


def advice_at_home(reason: Reason) -> str:
    """What happened and what to do, in the session's words; here each stop ends the command."""
    sentence = reason.sentence(_WORDS).replace("start again, then confirm", "then start again")
    return sentence.replace("start the session again", "start again")


class HeldKey:
    """Whether a terminal's key is held, judged by its auto-repeat.

    A press or two hold nothing: only repeats that come for `HOLD_NS` show that the key is held. So
    the arm moves about a second after the key went down, and never by a tap.
    """

    def __init__(self) -> None:
        self._pressed_ns: int | None = None
        self._repeats_since_ns: int | None = None

    def press(self, now_ns: int) -> None:
        if not self._within(now_ns):
            self._repeats_since_ns = None
        elif self._repeats_since_ns is None:
            self._repeats_since_ns = now_ns
        self._pressed_ns = now_ns

    def held(self, now_ns: int) -> bool:
        if self._pressed_ns is None or self._repeats_since_ns is None:
            return False
        return self._pressed_ns - self._repeats_since_ns >= HOLD_NS and self._within(now_ns)

    def _within(self, now_ns: int) -> bool:
        if self._pressed_ns is None:
            return False
        repeats = self._repeats_since_ns is not None
        return now_ns - self._pressed_ns <= (REPEAT_NS if repeats else FIRST_REPEAT_NS)


@dataclass(frozen=True, slots=True)
class HomingPath:
    """The straight line in joint space from where the arm is to the ready pose."""

    start: Vector  # [rad], shape (6,)
    goal: Vector  # [rad], shape (6,)
    travel_rad: float  # of the joint that turns furthest
    tcp_path_m: float
    lowest_m: float  # height of the TCP

    def duration_s(self, speed_rad_s: float) -> float:
        """Time for it at `speed_rad_s` of the fastest joint, without ramps [s]."""
        return self.travel_rad / speed_rad_s

    def left_rad(self, joints: Vector) -> float:
        """What the joint that has furthest to go has left from `joints` [rad]."""
        return float(np.abs(joints - self.goal).max())

    def passes(self, joints: Vector) -> bool:
        """Whether `joints` [rad] lie on it: from there the rest of it is the same path."""
        change = self.goal - self.start
        length = float(change @ change)
        fraction = float((joints - self.start) @ change) / length if length > 0.0 else 0.0
        nearest = self.start + min(max(fraction, 0.0), 1.0) * change
        return float(np.abs(joints - nearest).max()) <= OFF_PATH_RAD


def path_to_ready(config: Config, joints: Vector) -> HomingPath:
    """The path from `joints` [rad]; DeviceError if the gripper would dip under the floor."""
    goal = np.radians(np.array(config.arm.ready_joints_deg))
    kinematics = arm_kind(config.arm.model).kinematics(config.arm)
    fractions = np.linspace(0.0, 1.0, _SAMPLES)
    points = np.array(
        [kinematics.tcp_pose(joints + f * (goal - joints)).position for f in fractions]
    )
    path = HomingPath(
        start=joints,
        goal=goal,
        travel_rad=float(np.abs(goal - joints).max()),
        tcp_path_m=float(np.linalg.norm(np.diff(points, axis=0), axis=1).sum()),
        lowest_m=float(points[:, 2].min()),
    )
    lowest_allowed_m = min(config.limits.floor_mm / 1000.0, float(points[0, 2]))
    if path.lowest_m < lowest_allowed_m - _FLOOR_TOLERANCE_M:
        raise DeviceError(
            "On its path to the ready pose the gripper would dip to "
            f"{path.lowest_m * 1000:.0f} mm, below limits.floor_mm: "
            "lift the arm by hand guiding, then try again."
        )
    return path


class HomingState(StrEnum):
    """How far the motion to the ready pose has come."""

    WAITING = "waiting"  # for the key
    ARMING = "arming"  # until the guard has reported that it watches
    STARTING = "starting"
    MOVING = "moving"
    DONE = "done"
    ENDED = "ended"  # by the operator, before it was there
    FAILED = "failed"


_OVER = (HomingState.DONE, HomingState.ENDED, HomingState.FAILED)
_ARMING = {
    HomingState.ARMING: ArmingState.READY,  # what arms the guard
    HomingState.STARTING: ArmingState.ENGAGED,
    HomingState.MOVING: ArmingState.ENGAGED,
    HomingState.FAILED: ArmingState.FAULT,
}


class Homing:
    """Arms once the key is held, starts once guarded, stops on release; over when the arm is there.

    An ENABLE is to begin the move. The sample's trigger is a press of the key: what is read at once
    is one. An emergency stop is any other key. An arm that was stopped has to report so before
    anything starts again; until then the guard watches it. `all_shown`: the operator can have read
    everything, the path above all; until then a press starts nothing.
    """

    def __init__(self, config: Config, joints: Vector, guarded: Callable[[int], bool]) -> None:
        """From `joints` [rad]; DeviceError if the way to the ready pose is none.

        `guarded`: whether the guard watches at a time [ns].
        """
        self._config, self._guarded = config, guarded
        self._watch = Watch(config, video_floor_ns=0)
        self._key = HeldKey()
        self._began_ns = 0
        self._stopped_ns: int | None = None  # since then the arm has not yet reported its stop
        self.path = path_to_ready(config, joints)
        self.state = HomingState.WAITING
        self.all_shown = False
        self.refusal = ""  # why the arm did not begin the move, from any thread
        self.failure = ""  # why it failed, in one sentence

    @property
    def over(self) -> bool:
        return self.state in _OVER

    def step(self, inputs: TeleopInput) -> TeleopOutput:
        """Take in what happened; DeviceError if the way from where the arm is now is none."""
        arm, stopped_ns, before = inputs.arm, self._stopped_ns, self.state
        if arm is not None and stopped_ns is not None and arm.received_ns > stopped_ns:
            self._stopped_ns = None if arm.activity is Activity.STOPPED else stopped_ns
        request = Request.NONE if self.over else self._step(inputs)
        if self.over or (self.state is HomingState.WAITING and before is not HomingState.WAITING):
            self._stopped_ns = inputs.now_ns
        stop, arming = self._stopped_ns is not None, _ARMING.get(self.state, ArmingState.DISARMED)
        held = arming is ArmingState.ENGAGED
        return TeleopOutput(
            None, None, stop, request, arming, None, "", held, False, 1.0, False, None
        )

    def _step(self, inputs: TeleopInput) -> Request:
        if inputs.sample.trigger > 0.0 and (
            self.state is not HomingState.WAITING or self.all_shown
        ):
            self._key.press(inputs.now_ns)
        if inputs.estop:
            self.state = HomingState.ENDED
        elif (reason := _first(self._watch.faults(inputs, ArmingState.DISARMED))) is not None:
            self._fail_for(reason, inputs)
        elif self.state is HomingState.WAITING:
            self._wait(inputs)
        else:
            return self._go(inputs)
        return Request.NONE

    def _wait(self, inputs: TeleopInput) -> None:
        if inputs.arm is not None and self._is_there(inputs.arm):
            self.state = HomingState.DONE
        elif inputs.arm is not None and self._key.held(inputs.now_ns) and self._may_start(inputs):
            self._arm(inputs.arm)

    def _may_start(self, inputs: TeleopInput) -> bool:
        return self._stopped_ns is None and self._hold(inputs) is None

    def _arm(self, arm: ArmState) -> None:
        """If the path from here is still the one that was shown.

        An arm that was moved by hand meanwhile gets a path of its own, shown and held for anew.
        """
        path = path_to_ready(self._config, arm.joints)
        if self.path.passes(path.start):
            self.state, self.refusal = HomingState.ARMING, ""
        else:
            self.path, self._key = path, HeldKey()

    def _go(self, inputs: TeleopInput) -> Request:
        """Between the key's being held and its release."""
        if (hold := self._hold(inputs)) is not None:
            self._fail_for(hold, inputs)
        elif self.refusal:
            self._fail(self.refusal)
        elif not self._key.held(inputs.now_ns):
            self.state = HomingState.WAITING
        elif self.state is HomingState.ARMING and self._guarded(inputs.now_ns):
            self.state = HomingState.STARTING
            return Request.ENABLE
        elif self.state is HomingState.STARTING and inputs.arm_ready:
            self.state, self._began_ns = HomingState.MOVING, inputs.now_ns
        elif self.state is HomingState.MOVING:
            self._follow(inputs)
        return Request.NONE

    def _follow(self, inputs: TeleopInput) -> None:
        arm = inputs.arm
        if arm is None or arm.received_ns <= self._began_ns:
            return  # a report from before the start says nothing
        if arm.activity.is_halted:
            self._fail_for(Reason.ARM_STOPPED, inputs)
        elif arm.activity is Activity.IDLE and self._is_there(arm):
            self.state = HomingState.DONE
        elif arm.activity is Activity.IDLE and inputs.now_ns - self._began_ns > NO_MOTION_NS:
            self._fail(_STANDS_STILL)

    def _hold(self, inputs: TeleopInput) -> Reason | None:
        return _first(self._watch.holds(inputs, ArmingState.DISARMED))

    def _is_there(self, arm: ArmState) -> bool:
        return self.path.left_rad(arm.joints) < ARRIVED_RAD

    def _fail_for(self, reason: Reason, inputs: TeleopInput) -> None:
        fault = None if inputs.arm is None else inputs.arm.fault
        if reason is Reason.ARM_ERROR and fault is not None:
            self._fail(fault.sentence)
        else:
            told_by_the_link = reason in _TOLD_BY_THE_LINK
            self._fail(inputs.link.failure if told_by_the_link else advice_at_home(reason))

    def _fail(self, sentence: str) -> None:
        self.state, self.failure = HomingState.FAILED, sentence


def _first(reasons: list[Reason]) -> Reason | None:
    return min(reasons, key=tuple(Reason).index, default=None)
