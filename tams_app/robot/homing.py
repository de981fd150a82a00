"""The decisions of moving to the ready pose, which happens only while the operator holds a key.

Pure: time, key presses and the arm's state come in, ARM, START and STOP come out; `home_run.py`
acts.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum, StrEnum

import numpy as np

from hw.arms import arm_kind
from tams_app.config import Config
from tams_app.errors import DeviceError
from tams_app.records import Activity, ArmState, CommandLink, Vector
from tams_app.units import NS_PER_MS, NS_PER_S

# A key that is held repeats: after up to 0.66 s (X11's default), then every 25 to 100 ms.
FIRST_REPEAT_NS = 700 * NS_PER_MS
REPEAT_NS = 250 * NS_PER_MS
HOLD_NS = 300 * NS_PER_MS  # of repeats: some quick taps are no held key

ARRIVED_RAD = 0.005
OFF_PATH_RAD = math.radians(2.0)  # further from the path that was shown, it is another one
SILENT_NS = 300 * NS_PER_MS  # of the arm's reports, which come every 10 ms
NO_MOTION_NS = NS_PER_S  # a controller that stands still for so long has given up
_SAMPLES = 100
_FLOOR_TOLERANCE_M = 0.001


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


class Action(Enum):
    """What is to be done now."""

    NONE = "none"
    ARM = "arm"  # the guard
    START = "start"
    STOP = "stop"


class HomingState(StrEnum):
    """How far the motion to the ready pose has come."""

    WAITING = "waiting"  # for the key
    ARMING = "arming"  # until the guard has said that it watches
    STARTING = "starting"
    CANCELLING = "cancelling"  # released while it was starting
    MOVING = "moving"
    DONE = "done"
    ENDED = "ended"  # by the operator, before it was there
    FAILED = "failed"


_OVER = (HomingState.DONE, HomingState.ENDED, HomingState.FAILED)


@dataclass(frozen=True, slots=True)
class HomingInput:
    """What one step is decided on."""

    now_ns: int
    pressed: bool  # the deadman key; what is read at once is one press
    other_key: bool
    arm: ArmState | None
    link: CommandLink
    began: bool = False  # the move that was started is under way
    refused: str = ""  # ... or was refused, and why
    guarded: bool = False  # the guard has acknowledged the newest arming
    guard: str = ""  # what is wrong with the guard


class Homing:
    """ARM once the key is held, START once guarded, STOP on release; over when the arm is there."""

    def __init__(self, goal: Vector) -> None:
        """`goal`: joints [rad], shape (6,)."""
        self._goal = goal
        self._key = HeldKey()
        self._began_ns = 0
        self.state = HomingState.WAITING
        self.reason = ""  # why it failed, in one sentence

    @property
    def over(self) -> bool:
        return self.state in _OVER

    def step(self, tick: HomingInput) -> Action:
        """Take in what happened; what is to be done about it."""
        if self.over:
            return Action.NONE
        if tick.pressed:
            self._key.press(tick.now_ns)
        if tick.other_key:
            return self._finish(HomingState.ENDED)
        if problem := self._problem(tick):
            return self._finish(HomingState.FAILED, problem)
        held = self._key.held(tick.now_ns)
        match self.state:
            case HomingState.WAITING:
                return self._waiting(tick, held)
            case HomingState.ARMING:
                return self._arming(tick, held)
            case HomingState.STARTING:
                return self._starting(tick, held)
            case HomingState.MOVING:
                return self._moving(tick, held)
            case _:
                return self._cancelling(tick)

    def _waiting(self, tick: HomingInput, held: bool) -> Action:
        if tick.arm is not None and self._is_there(tick.arm):
            return self._finish(HomingState.DONE)
        if not held:
            return Action.NONE
        self.state = HomingState.ARMING
        return Action.ARM

    def _arming(self, tick: HomingInput, held: bool) -> Action:
        if not held:
            self.state = HomingState.WAITING
            return Action.STOP
        if not tick.guarded:
            return Action.NONE
        self.state = HomingState.STARTING
        return Action.START

    def _starting(self, tick: HomingInput, held: bool) -> Action:
        if not held:
            self.state = HomingState.CANCELLING
            return Action.STOP
        if tick.began:
            self.state = HomingState.MOVING
            self._began_ns = tick.now_ns
        return Action.NONE

    def _cancelling(self, tick: HomingInput) -> Action:
        if not (tick.began or tick.refused):
            return Action.NONE
        self.state = HomingState.WAITING
        return Action.STOP  # the one before may have come before the start

    def _moving(self, tick: HomingInput, held: bool) -> Action:
        if not held:
            self.state = HomingState.WAITING
            return Action.STOP
        arm = tick.arm
        if arm is None or arm.received_ns <= self._began_ns:
            return Action.NONE  # a report from before the start says nothing
        if arm.activity.is_halted:
            return self._finish(
                HomingState.FAILED, "The arm was stopped from elsewhere; find out why, then again."
            )
        if arm.activity is Activity.IDLE and self._is_there(arm):
            return self._finish(HomingState.DONE)
        if arm.activity is Activity.IDLE and tick.now_ns - self._began_ns > NO_MOTION_NS:
            return self._finish(
                HomingState.FAILED,
                "The arm stands still on its path; look for what holds it.",
            )
        return Action.NONE

    def _problem(self, tick: HomingInput) -> str:
        """Why it cannot go on, in one sentence; "" if it can."""
        if tick.refused and self.state is not HomingState.CANCELLING:
            return tick.refused
        arm = tick.arm
        if arm is not None and arm.fault is not None:
            return arm.fault.sentence
        if tick.link.failure or tick.guard:
            return tick.link.failure or tick.guard
        if arm is None or tick.now_ns - arm.received_ns > SILENT_NS:
            return "The arm has stopped reporting; check its power and network cable."
        return ""

    def _is_there(self, arm: ArmState) -> bool:
        return float(np.abs(arm.joints - self._goal).max()) < ARRIVED_RAD

    def _finish(self, state: HomingState, reason: str = "") -> Action:
        self.state, self.reason = state, reason
        return Action.STOP
