"""The arm's joints now, from an old report of them and the hand's samples since.

A Smith predictor whose model is the robot's own rule: `Drive` turns the operator's samples into
twists, as it does beside the arm, for an arm that follows them at once. What the arm has done since
the report is what that model has done between the sample that shows in the report and the one that
shows now:

    q(t) = q(report) + m(t - way - lag) - m(report - way - lag)

way: from the sending of a sample until the loop beside the arm has it. lag: from its command until
that shows in the reported joints.
"""

from __future__ import annotations

import math
from bisect import bisect_right
from collections import deque
from dataclasses import dataclass
from operator import itemgetter

import numpy as np
from numpy.typing import NDArray

from tams_app.config import Config
from tams_app.records import (
    Activity,
    ArmKinematics,
    ArmState,
    ControllerSample,
    ServoMode,
    Vector,
)
from tams_app.rotation import Rotation
from tams_app.teleop.clutch import Clutch
from tams_app.teleop.drive import Drive
from tams_app.teleop.limits import joint_speeds
from tams_app.teleop.safety import ArmingState
from tams_app.teleop.trajectory import TrajectoryError
from tams_app.units import NS_PER_MS, NS_PER_S

GOOD_M, WORST_M = 0.010, 0.030
_BETTER = 0.5  # times the error of what is not predicted
_KEPT_NS = 3 * NS_PER_S
_CHECKED_NS = 2 * NS_PER_S  # how long an error counts
_PREDICTED = 1000  # that wait to be checked, while nothing is received
_MOVABLE = (ArmingState.READY, ArmingState.ENGAGED)


class Trail:
    """A vector over time, of the last seconds: samples in order, linear between them."""

    def __init__(self, kept_ns: int) -> None:
        """`kept_ns`: what is older than the newest by more may be forgotten."""
        self._kept_ns = kept_ns
        self._samples: deque[tuple[int, Vector]] = deque()

    def __len__(self) -> int:
        return len(self._samples)

    @property
    def newest(self) -> tuple[int, Vector]:
        """The last sample; IndexError where there is none."""
        return self._samples[-1]

    def add(self, t_ns: int, value: Vector) -> None:
        """One more; one that is not newer than the last is left out."""
        if self._samples and t_ns <= self._samples[-1][0]:
            return
        self._samples.append((t_ns, value))
        while len(self._samples) > 1 and self._samples[1][0] < t_ns - self._kept_ns:
            self._samples.popleft()

    def covers(self, t_ns: int, beyond_ns: int) -> bool:
        """Whether `t_ns` is within the samples, or after the newest by at most `beyond_ns`."""
        if not self._samples:
            return False
        return self._samples[0][0] <= t_ns <= self._samples[-1][0] + beyond_ns

    def at(self, t_ns: int, ahead_ns: int = 0) -> Vector:
        """The value then; before the oldest and after the newest sample, theirs.

        `ahead_ns`: the newest two are continued for so long after the newest. IndexError where
        there is none.
        """
        samples = self._samples
        after = bisect_right(samples, t_ns, key=itemgetter(0))
        if after == 0:
            return samples[0][1]
        if after == len(samples):
            if len(samples) == 1 or not ahead_ns:
                return samples[-1][1]
            after, t_ns = after - 1, min(t_ns, samples[-1][0] + ahead_ns)
        before_ns, before = samples[after - 1]
        after_ns, later = samples[after]
        return before + (later - before) * ((t_ns - before_ns) / (after_ns - before_ns))


@dataclass(frozen=True, slots=True)
class ArmHeard:
    """What was received of the arm; times are of the operator's clock.

    joints: measured at `t_ns` [rad], shape (6,). until_ns: when the newest of our samples was sent
    that the loop beside the arm had at `t_ns`; None: none. speed_scale: as the robot's side slows
    the arm, 0 to 1. lag_ns: what was commanded so lately does not show in the joints yet.
    """

    t_ns: int
    joints: Vector
    until_ns: int | None
    arming: ArmingState
    orientation_mode: bool
    speed_scale: float
    lag_ns: int = 0


@dataclass(frozen=True, slots=True)
class Forecast:
    """The arm at a time.

    joints: [rad], shape (6,). commanded: where all samples that were sent lead, once they have
    taken effect. error_m: how far off the TCP was in the last two seconds where it was
    predicted, at worst; late_m: where the newest state had it, at worst. 0 while nothing was
    predicted that has been received since.
    """

    joints: Vector
    commanded: Vector
    error_m: float
    late_m: float

    @property
    def is_trusted(self) -> bool:
        """Whether predictions have been good, or much better than none, and never far off."""
        if self.error_m <= GOOD_M:
            return True
        return self.error_m <= WORST_M and self.error_m <= _BETTER * self.late_m


class ForwardModel:
    """Give it each sample that is sent and each state that is received; `at` tells the joints."""

    def __init__(self, config: Config, model: ArmKinematics, ready: Rotation) -> None:
        """`ready`: TCP rotation at the ready pose, as for `Teleop`."""
        self._model = model
        self._drive = Drive(config, model, ready)
        self._clutch = Clutch(config.freshness.buttons_ms * NS_PER_MS)
        self._stall_s = config.arm.velocity_deadman_s
        self._engaged = False
        self._changed_ns = 0  # when trigger or mode was changed last
        self._moved: Vector = np.zeros(6)  # by the model since the start
        self._trail = Trail(_KEPT_NS)  # of `_moved`, by when a sample was sent
        self._measured = Trail(_KEPT_NS)
        self._heard: ArmHeard | None = None
        self._joints: Vector = np.zeros(6)  # of the model, once the newest sample counts
        self._last_ns: int | None = None
        self._way_ns = 0
        self._predicted: deque[tuple[int, Vector, Vector]] = deque(maxlen=_PREDICTED)
        self._errors: deque[tuple[int, float, float]] = deque()

    def sent(self, sample: ControllerSample, now_ns: int) -> None:
        """A sample is on its way."""
        interval_s = 0.0 if self._last_ns is None else max(0, now_ns - self._last_ns) / NS_PER_S
        self._last_ns = now_ns
        buttons = self._clutch.update(sample, now_ns)
        heard = self._heard
        if heard is None:
            return
        if interval_s > self._stall_s:  # the arm stops by itself, as `Teleop` has it
            self._drive.halt()
        self._move(interval_s)
        self._trail.add(now_ns, self._moved)
        if heard.arming not in _MOVABLE:
            self._engaged = False
            self._drive.reset()
            return
        if buttons.press or buttons.toggle_mode or (self._engaged and not buttons.pressed):
            self._changed_ns = now_ns
        if buttons.press:
            self._drive.engage()
        if buttons.toggle_mode:
            self._drive.toggle_mode()
        self._engaged = buttons.press or (self._engaged and buttons.pressed)
        self._drive.note_interval(now_ns, interval_s)
        try:
            if self._engaged:
                arm, scale = self._arm(now_ns), heard.speed_scale
                self._drive.follow(sample, arm, 0, scale, now_ns, interval_s)
            else:
                self._drive.rest(interval_s)
        except TrajectoryError:
            self._drive.reset()

    def heard(self, state: ArmHeard, way_ns: int) -> bool:
        """A state was received; False if it is not newer than the last, and is left out.

        `way_ns`: how long our samples take to the robot's side now.
        """
        if self._heard is not None and state.t_ns <= self._heard.t_ns:
            return False
        self._check(state)
        self._heard, self._way_ns = state, way_ns
        self._measured.add(state.t_ns, state.joints)
        self._adopt(state)
        if self._trail:
            shown = self._trail.at(self._shows_ns(state, state.t_ns))
            self._joints = state.joints + self._moved - shown
        else:
            self._joints = state.joints
        return True

    def at(self, t_ns: int) -> Forecast | None:
        """The joints at `t_ns`, then or to come; None before the first state."""
        heard = self._heard
        if heard is None:
            return None
        if t_ns <= heard.t_ns or not self._trail:
            return Forecast(self._measured.at(t_ns), self._joints, 0.0, 0.0)
        start = self._trail.at(self._shows_ns(heard, heard.t_ns))
        joints = heard.joints + self._trail.at(self._shows_ns(heard, t_ns)) - start
        self._predicted.append((t_ns, joints, heard.joints))
        error_m = max((error_m for _, error_m, _ in self._errors), default=0.0)
        late_m = max((late_m for _, _, late_m in self._errors), default=0.0)
        return Forecast(joints, self._joints, error_m, late_m)

    def _shows_ns(self, state: ArmHeard, t_ns: int) -> int:
        """When the newest sample was sent that shows in the joints at `t_ns`."""
        return t_ns - self._way_ns - state.lag_ns

    def _adopt(self, state: ArmHeard) -> None:
        """Correct what the model believes of trigger and mode, unless it is yet to be received."""
        if state.until_ns is None or state.until_ns < self._changed_ns:
            return
        engaged = state.arming is ArmingState.ENGAGED
        if engaged and not self._engaged:
            self._drive.engage()
        self._engaged = engaged
        if state.orientation_mode != self._drive.orientation_mode:
            self._drive.toggle_mode()

    def _arm(self, now_ns: int) -> ArmState:
        """The model's arm, as a report that is not late."""
        return ArmState(
            received_ns=now_ns,
            joints=self._joints,
            tcp=self._model.tcp_pose(self._joints),
            activity=Activity.MOVING,
            servo=ServoMode.VELOCITY,
            fault=None,
            gripper_closed=None,
        )

    def _move(self, interval_s: float) -> None:
        twist = self._drive.twist
        wanted = (*twist.linear, *twist.angular)
        speeds = joint_speeds(self._model, wanted, self._joints) if any(wanted) else None
        if speeds is None:
            return
        change: NDArray[np.float64] = np.array(speeds) * interval_s
        self._moved = self._moved + change
        self._joints = self._joints + change

    def _check(self, state: ArmHeard) -> None:
        """Compare what was predicted for this time with what is received of it."""
        oldest_ns = state.t_ns - _CHECKED_NS
        while self._errors and self._errors[0][0] < oldest_ns:
            self._errors.popleft()
        before = self._heard
        while self._predicted and self._predicted[0][0] <= state.t_ns:
            t_ns, joints, heard = self._predicted.popleft()
            if before is None or t_ns < before.t_ns:
                continue
            share = (t_ns - before.t_ns) / (state.t_ns - before.t_ns)
            true = before.joints + (state.joints - before.joints) * share
            self._errors.append((t_ns, self._apart_m(joints, true), self._apart_m(heard, true)))

    def _apart_m(self, joints: Vector, others: Vector) -> float:
        one, other = (self._model.tcp_pose(each).position for each in (joints, others))
        return math.sqrt((one - other) @ (one - other))
