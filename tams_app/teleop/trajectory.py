"""Jerk-limited trajectories to a velocity: acceleration and jerk hold as norms, not per axis.

Ruckig limits each axis for itself. Here it works in a plane that is chosen for every trajectory:
first axis along the change of velocity that is wanted, second along the acceleration across it. The
limits are split over the two axes like cosine and sine, so that the norms never exceed the profile,
while a motion along one line gets all of it.

An acceleration across can leave the split next to nothing along. No trajectory is slower than
taking the acceleration away first and going along one line then: that bounds how long every stop
takes.
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

_TINY = 1e-12
_SLACK = 1.0 + 1e-9  # rounding must not put the present state outside its own limits
_SPLIT_STEPS = 7
_LEAST_SPLIT = 1e-3  # ruckig fails on an axis without any jerk
_LEAST_SHARE = 0.05  # of the acceleration, for either axis, for the same reason
_MOST_SHARE = 0.998  # hypot with the least share stays below 1


class TrajectoryError(ArithmeticError):
    """Ruckig refused the input or found no trajectory."""


@dataclass(frozen=True, slots=True)
class Profile:
    """Norms of acceleration and jerk: [m/s²], [m/s³] or [rad/s²], [rad/s³]."""

    acceleration: float
    jerk: float


@dataclass(frozen=True, slots=True)
class MotionState:
    """Displacement since the trajectory began, velocity and acceleration, shape (3,) each."""

    displacement: Vector
    velocity: Vector
    acceleration: Vector

    @staticmethod
    def moving(velocity: Vector, acceleration: Vector) -> MotionState:
        return MotionState(np.zeros(3), velocity, acceleration)


class VelocityTrajectory:
    """From a velocity and acceleration to a constant target velocity, within a profile."""

    def __init__(
        self, velocity: Vector, acceleration: Vector, target: Vector, profile: Profile
    ) -> None:
        """All vectors of shape (3,); raises TrajectoryError, also for input that is not finite."""
        start = MotionState.moving(velocity, acceleration)
        law: _BothAxes | _OneByOne = _BothAxes(start, target, profile)
        if law.duration_s > one_by_one_s(velocity, acceleration, target, profile):
            law = _OneByOne(start, target, profile)
        self._law, self._target = law, target
        self.duration_s: float = law.duration_s

    def at(self, t_s: float) -> MotionState:
        """The state `t_s` ≥ 0 after the start; exactly the target once the trajectory has ended."""
        state = self._law.at(min(t_s, self.duration_s))
        if t_s < self.duration_s:
            return state
        displacement = state.displacement + self._target * (t_s - self.duration_s)
        return MotionState(displacement, self._target.copy(), np.zeros(3))


def one_by_one_s(velocity: Vector, acceleration: Vector, target: Vector, profile: Profile) -> float:
    """How long [s] to take the acceleration away and then go straight to `target` takes."""
    coast_s = norm(acceleration) / profile.jerk
    change = target - velocity - acceleration * (coast_s / 2.0)
    return coast_s + stop_time_s(norm(change), profile.acceleration, profile.jerk)


def coasting(start: MotionState, jerk: float, t_s: float) -> MotionState:
    """The state `t_s` after `start` when the acceleration is taken away with `jerk`."""
    size = norm(start.acceleration)
    coast_s = size / jerk
    if coast_s <= t_s:
        coasted = start.velocity + start.acceleration * (coast_s / 2.0)
        displacement = start.velocity * coast_s + start.acceleration * (coast_s**2 / 3.0)
        return MotionState(displacement + coasted * (t_s - coast_s), coasted, np.zeros(3))
    rest = start.acceleration * (1.0 - t_s / coast_s)
    mean = (start.acceleration + rest) / 2.0
    displacement = start.velocity * t_s + (2.0 * start.acceleration + rest) * (t_s**2 / 6.0)
    return MotionState(displacement, start.velocity + mean * t_s, rest)


class _BothAxes:
    """Along the change of velocity and across it at the same time."""

    def __init__(self, start: MotionState, target: Vector, profile: Profile) -> None:
        self._start, self._target = start, target
        change = target - start.velocity
        size = norm(change)
        self._along, self._across, a_along, a_across = _plane(change, size, start.acceleration)
        self._trajectory = _solve(size, a_along, a_across, profile)
        self.duration_s: float = self._trajectory.duration

    def at(self, t_s: float) -> MotionState:
        if t_s <= 0.0:
            return self._start
        position, velocity, acceleration = self._trajectory.at_time(t_s)
        displacement = self._target * t_s + self._along * position[0] + self._across * position[1]
        return MotionState(
            displacement,
            self._target + self._along * velocity[0] + self._across * velocity[1],
            self._along * acceleration[0] + self._across * acceleration[1],
        )


class _OneByOne:
    """First the acceleration is taken away, then the velocity changes along one line."""

    def __init__(self, start: MotionState, target: Vector, profile: Profile) -> None:
        self._start, self._jerk = start, profile.jerk
        self._coast_s = norm(start.acceleration) / profile.jerk
        self._coasted = coasting(start, profile.jerk, self._coast_s)
        line_start = MotionState.moving(self._coasted.velocity, self._coasted.acceleration)
        self._line = _BothAxes(line_start, target, profile)
        self.duration_s: float = self._coast_s + self._line.duration_s

    def at(self, t_s: float) -> MotionState:
        if t_s <= self._coast_s:
            return coasting(self._start, self._jerk, max(0.0, t_s))
        state = self._line.at(t_s - self._coast_s)
        displacement = self._coasted.displacement + state.displacement
        return MotionState(displacement, state.velocity, state.acceleration)


def norm(vector: Vector) -> float:
    return math.sqrt(float(vector @ vector))


def _plane(
    change: Vector, size: float, acceleration: Vector
) -> tuple[Vector, Vector, float, float]:
    """Unit vectors along the change and across it, and the acceleration's parts on them."""
    a_size = norm(acceleration)
    if size > _TINY:
        along = change / size
    elif a_size > _TINY:
        along = acceleration / a_size
    else:
        along = np.array([1.0, 0.0, 0.0])
    a_along = float(acceleration @ along)
    rest = acceleration - a_along * along
    a_across = norm(rest)
    if a_across <= _TINY:
        return along, np.zeros(3), a_along, 0.0
    return along, rest / a_across, a_along, a_across


def _solve(change: float, a_along: float, a_across: float, profile: Profile) -> Trajectory:
    """The one whose slower axis is as fast as possible, by bisection of the limits' split."""
    request = InputParameter(2)
    request.control_interface = ControlInterface.Velocity
    request.synchronization = Synchronization.No
    request.max_velocity = [1e3, 1e3]  # the velocity interface does not use it (FINDINGS 10)
    request.current_velocity = [-change, 0.0]
    request.current_acceleration = [a_along, a_across]
    trajectory = Trajectory(2)
    planner = Ruckig(2)

    def calculate(accelerations: list[float], jerks: list[float]) -> tuple[float, float]:
        request.max_acceleration = accelerations
        request.max_jerk = jerks
        try:
            planner.calculate(request, trajectory)
        except (RuckigError, ValueError) as error:  # ValueError: a result without a name
            raise TrajectoryError(str(error)) from error
        along_s, across_s = trajectory.independent_min_durations
        return along_s, across_s

    if a_across == 0.0:  # the second axis rests: the first gets all
        most = max(profile.acceleration, abs(a_along)) * _SLACK
        calculate([most, most], [profile.jerk, profile.jerk])
        return trajectory
    _split(calculate, a_along, a_across, profile)
    return trajectory


def _split(
    calculate: Callable[[list[float], list[float]], tuple[float, float]],
    a_along: float,
    a_across: float,
    profile: Profile,
) -> None:
    """Bisect the angle between the two axes' limits until both take equally long."""
    least = _LEAST_SHARE * profile.acceleration
    bound = max(_MOST_SHARE * profile.acceleration, math.hypot(a_along, a_across))
    gentlest = math.asin(min(1.0, a_across / bound))
    steepest = math.acos(min(1.0, abs(a_along) / bound))

    def durations_s(split: float) -> tuple[float, float]:
        a_split = min(max(split, gentlest), steepest)
        accelerations = [
            max(bound * math.cos(a_split) * _SLACK, least),
            max(bound * math.sin(a_split) * _SLACK, least),
        ]
        return calculate(
            accelerations, [profile.jerk * math.cos(split), profile.jerk * math.sin(split)]
        )

    low, high = _LEAST_SPLIT, math.pi / 2 - _LEAST_SPLIT
    for _ in range(_SPLIT_STEPS):
        middle = (low + high) / 2.0
        along_s, across_s = durations_s(middle)
        if along_s < across_s:
            low = middle
        else:
            high = middle
    durations_s(high)
