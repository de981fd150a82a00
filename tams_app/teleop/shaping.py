"""Jerk-limited velocity in space: speed, acceleration and jerk hold as norms, not per axis.

Ruckig limits each axis for itself. Here it works in a plane that is laid for every plan: first axis
along the change of velocity that is wanted, second along the acceleration across it. The limits are
split over the two axes like cosine and sine, so that the norms never exceed the profile, while a
motion along one line gets all of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from ruckig import (
    ControlInterface,
    InputParameter,
    Ruckig,
    RuckigError,
    Synchronization,
    Trajectory,
)

from tams_app.config import stop_time_s
from tams_app.records import Vector

Admissible = Callable[[Vector, Vector], bool]

_TINY = 1e-12
_SLACK = 1.0 + 1e-9  # rounding must not put the present state outside its own limits
_SPLIT_STEPS = 7
_LEAST_SPLIT = 1e-3  # ruckig fails on an axis without any jerk
_LEAST_SHARE = 0.05  # of the acceleration, for either axis, for the same reason
_MOST_SHARE = 0.998  # hypot with the least share stays below 1


class TrajectoryError(ArithmeticError):
    """Ruckig refused the input or found no way."""


@dataclass(frozen=True, slots=True)
class Profile:
    """Norms of acceleration and jerk: [m/s²], [m/s³] or [rad/s²], [rad/s³]."""

    acceleration: float
    jerk: float


@dataclass(frozen=True, slots=True)
class MotionState:
    """Displacement since the plan began, velocity and acceleration, shape (3,) each."""

    displacement: Vector
    velocity: Vector
    acceleration: Vector


class VelocityPlan:
    """The way from a velocity and acceleration to a constant target velocity, within a profile."""

    def __init__(
        self, velocity: Vector, acceleration: Vector, target: Vector, profile: Profile
    ) -> None:
        """All vectors of shape (3,); raises TrajectoryError, also for input that is not finite."""
        self.profile = profile
        self._target = target
        change = target - velocity
        size = _norm(change)
        along, across, a_along, a_across = _plane(change, size, acceleration)
        self._along, self._across = along, across
        self._start = MotionState(np.zeros(3), velocity, acceleration)
        self._trajectory = _solve(size, a_along, a_across, profile)
        self.duration_s: float = self._trajectory.duration

    def at(self, t_s: float) -> MotionState:
        """The state `t_s` ≥ 0 after the start; exactly the target once the plan is done."""
        if t_s <= 0.0:
            return self._start
        position, velocity, acceleration = self._trajectory.at_time(t_s)
        displacement = self._target * t_s + self._along * position[0] + self._across * position[1]
        if t_s >= self.duration_s:
            return MotionState(displacement, self._target.copy(), np.zeros(3))
        return MotionState(
            displacement,
            self._target + self._along * velocity[0] + self._across * velocity[1],
            self._along * acceleration[0] + self._across * acceleration[1],
        )


class VelocityShaper:
    """Follows a target velocity within the motion profile and brakes within the stop profile.

    The speed never exceeds `max_speed`, also not while an acceleration that is under way dies out.
    Braking runs to exactly zero before anything else is followed. Sampled at the true interval
    between two ticks, so the limits hold at any rate and jitter.
    """

    def __init__(self, max_speed: float, motion: Profile, stop: Profile) -> None:
        self._max_speed = max_speed
        self._motion = motion
        self._stop = stop
        self._braking: VelocityPlan | None = None
        self._braking_for_s = 0.0
        self.used_stop_profile = False  # in the last step
        self.velocity: Vector = np.zeros(3)
        self.acceleration: Vector = np.zeros(3)

    @property
    def braking(self) -> bool:
        """Whether it is on its way to rest and will not follow a target before."""
        return self._braking is not None

    @property
    def at_rest(self) -> bool:
        return not (self.braking or self.velocity.any() or self.acceleration.any())

    def reset(self) -> None:
        """At rest at once: the arm was stopped by other means."""
        self._braking = None
        self.velocity, self.acceleration = np.zeros(3), np.zeros(3)

    def brake(self) -> None:
        """Come to rest within the stop profile, whatever target follows."""
        if self._braking is None and not self.at_rest:
            self._braking = self.braking_plan(self.velocity, self.acceleration)
            self._braking_for_s = 0.0

    def braking_plan(self, velocity: Vector, acceleration: Vector) -> VelocityPlan:
        """How `brake` would come to rest from that state."""
        return VelocityPlan(velocity, acceleration, np.zeros(3), self._stop)

    def braking_reach(self, velocity: Vector, acceleration: Vector, held_s: float) -> float:
        """An upper bound of the way of `held_s` at that velocity, then braking [m, rad].

        Taking the acceleration away first and then braking along one line is a way to rest within
        the profile; the plan is no slower.
        """
        a_size = _norm(acceleration)
        die_out_s = a_size / self._stop.jerk
        peak = _norm(velocity) + a_size * die_out_s / 2.0
        rest_s = stop_time_s(peak, self._stop.acceleration, self._stop.jerk)
        return peak * (held_s + die_out_s + rest_s)

    def step(
        self, target: Vector, interval_s: float, admissible: Admissible | None = None
    ) -> Vector:
        """Advance by `interval_s` towards `target`, shape (3,), and return the velocity.

        `admissible(velocity, acceleration)` tells whether braking from there stays in bounds; a
        state that does not pass is never taken on unless braking itself leads there. None: all are.
        """
        self.used_stop_profile = self._braking is not None
        if self._braking is not None:
            self._advance_braking(self._braking, interval_s)
        elif target.any() or not self.at_rest:
            self._advance(target, interval_s, admissible)
        return self.velocity

    def _advance(self, target: Vector, interval_s: float, admissible: Admissible | None) -> None:
        plan = VelocityPlan(self.velocity, self.acceleration, target, self._motion)
        towards = plan.at(interval_s)
        for state in (towards, self._coasting(interval_s)):
            if self._keeps_profile(state) and (
                admissible is None or admissible(state.velocity, state.acceleration)
            ):
                self.velocity, self.acceleration = state.velocity, state.acceleration
                return
        self.brake()
        self.used_stop_profile = True
        if self._braking is not None:
            self._advance_braking(self._braking, interval_s)

    def _advance_braking(self, plan: VelocityPlan, interval_s: float) -> None:
        self._braking_for_s += interval_s
        state = plan.at(self._braking_for_s)
        self.velocity, self.acceleration = state.velocity, state.acceleration
        if self._braking_for_s >= plan.duration_s:
            self.reset()

    def _coasting(self, interval_s: float) -> MotionState:
        """The state after `interval_s` of taking the acceleration away as fast as allowed."""
        size = _norm(self.acceleration)
        needed_s = size / self._motion.jerk
        if needed_s <= interval_s:
            end = self.velocity + self.acceleration * (needed_s / 2.0)
            return MotionState(np.zeros(3), end, np.zeros(3))
        rest = self.acceleration * (1.0 - interval_s / needed_s)
        end = self.velocity + (self.acceleration + rest) * (interval_s / 2.0)
        return MotionState(np.zeros(3), end, rest)

    def _keeps_profile(self, state: MotionState) -> bool:
        """The norm is convex, so it is largest at an end of the coasting that could follow."""
        bound = self._max_speed * _SLACK
        size = _norm(state.acceleration)
        if size > self._motion.acceleration * _SLACK:
            return False
        time_s = size / self._motion.jerk
        coasted = state.velocity + state.acceleration * (time_s / 2.0)
        return _norm(state.velocity) <= bound and _norm(coasted) <= bound


def _norm(vector: Vector) -> float:
    return math.sqrt(float(vector @ vector))


def _plane(
    change: Vector, size: float, acceleration: Vector
) -> tuple[Vector, Vector, float, float]:
    """Unit vectors along the change and across it, and the acceleration's parts on them."""
    a_size = _norm(acceleration)
    if size > _TINY:
        along = change / size
    elif a_size > _TINY:
        along = acceleration / a_size
    else:
        along = np.array([1.0, 0.0, 0.0])
    a_along = float(acceleration @ along)
    rest = acceleration - a_along * along
    a_across = _norm(rest)
    if a_across <= _TINY:
        return along, np.zeros(3), a_along, 0.0
    return along, rest / a_across, a_along, a_across


def _solve(change: float, a_along: float, a_across: float, profile: Profile) -> Trajectory:
    """The plan whose slower axis is as fast as possible, by bisection of the limits' split."""
    request = InputParameter(2)
    request.control_interface = ControlInterface.Velocity
    request.synchronization = Synchronization.No
    request.max_velocity = [1e3, 1e3]  # the velocity interface does not use it (FINDINGS 10)
    request.current_velocity = [-change, 0.0]
    request.current_acceleration = [a_along, a_across]
    trajectory = Trajectory(2)
    planner = Ruckig(2)
    least = _LEAST_SHARE * profile.acceleration
    bound = max(_MOST_SHARE * profile.acceleration, math.hypot(a_along, a_across))
    gentlest = math.asin(min(1.0, a_across / bound))
    steepest = math.acos(min(1.0, abs(a_along) / bound))

    def calculate(split: float) -> tuple[float, float]:
        a_split = min(max(split, gentlest), steepest)
        request.max_acceleration = [
            max(bound * math.cos(a_split) * _SLACK, least),
            max(bound * math.sin(a_split) * _SLACK, least),
        ]
        request.max_jerk = [profile.jerk * math.cos(split), profile.jerk * math.sin(split)]
        try:
            planner.calculate(request, trajectory)
        except (RuckigError, ValueError) as error:  # ValueError: a result without a name
            raise TrajectoryError(str(error)) from error
        along_s, across_s = trajectory.independent_min_durations
        return along_s, across_s

    if a_across == 0.0:
        calculate(_LEAST_SPLIT)
        return trajectory
    low, high = _LEAST_SPLIT, math.pi / 2 - _LEAST_SPLIT
    for _ in range(_SPLIT_STEPS):
        middle = (low + high) / 2.0
        along_s, across_s = calculate(middle)
        if along_s < across_s:
            low = middle
        else:
            high = middle
    calculate(high)
    return trajectory
