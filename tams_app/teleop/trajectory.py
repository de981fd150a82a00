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
import weakref
from typing import NamedTuple

from ruckig import (
    ControlInterface,
    InputParameter,
    Ruckig,
    RuckigError,
    Synchronization,
    Trajectory,
)

from tams_app.config import stop_time_s
from tams_app.vectors import ZERO, Floats3, dot, minus, norm, plus, plus_times, times

_TINY = 1e-12
_SLACK = 1.0 + 1e-9  # rounding must not put the present state outside its own limits
_SPLIT_STEPS = 7
_LEAST_SPLIT = 1e-3  # ruckig fails on an axis without any jerk
_LEAST_SHARE = 0.05  # of the acceleration, for either axis, for the same reason
_MOST_SHARE = 0.998  # hypot with the least share stays below 1
_THERE_AND_BACK = 1.0 + math.sqrt(2.0)  # times a/j: an acceleration away, and what it gave


class TrajectoryError(ArithmeticError):
    """Ruckig refused the input or found no trajectory."""


class Profile(NamedTuple):
    """Norms of acceleration and jerk: [m/s²], [m/s³] or [rad/s²], [rad/s³]."""

    acceleration: float
    jerk: float


class MotionState(NamedTuple):
    """Displacement since the trajectory began, velocity and acceleration."""

    displacement: Floats3
    velocity: Floats3
    acceleration: Floats3

    @staticmethod
    def moving(velocity: Floats3, acceleration: Floats3) -> MotionState:
        return MotionState(ZERO, velocity, acceleration)


class Planner:
    """Ruckig and its request, for the two axes; made once, which takes longer than a calculation.

    For one thread.
    """

    def __init__(self) -> None:
        request = InputParameter(2)
        request.control_interface = ControlInterface.Velocity
        request.synchronization = Synchronization.No
        request.max_velocity = [1e3, 1e3]  # not used by that interface (FINDINGS 10)
        self._made = [Ruckig(2), request]
        # what is alive when the process ends is told of as a leak, on the terminal
        weakref.finalize(self, self._made.clear)

    def plan(self, change: float, a_along: float, a_across: float, profile: Profile) -> Trajectory:
        """The trajectory whose slower axis is as fast as possible."""
        if a_across == 0.0:  # the second axis rests: the first gets all
            most = max(profile.acceleration, abs(a_along)) * _SLACK
            accelerations, jerks = [most, most], [profile.jerk, profile.jerk]
        else:
            accelerations, jerks = _split(change, a_along, a_across, profile)
        (ruckig, request), trajectory = self._made, Trajectory(2)
        request.current_velocity = [-change, 0.0]
        request.current_acceleration = [a_along, a_across]
        request.max_acceleration, request.max_jerk = accelerations, jerks
        try:
            ruckig.calculate(request, trajectory)
        except (RuckigError, ValueError) as error:  # ValueError: a result without a name
            raise TrajectoryError(str(error)) from error
        return trajectory


class VelocityTrajectory:
    """From a velocity and acceleration to a constant target velocity, within a profile."""

    def __init__(
        self,
        velocity: Floats3,
        acceleration: Floats3,
        target: Floats3,
        profile: Profile,
        planner: Planner | None = None,
    ) -> None:
        """Raises TrajectoryError, also for input that is not finite."""
        planner = planner or Planner()
        start = MotionState.moving(velocity, acceleration)
        law: _BothAxes | _OneByOne = _BothAxes(start, target, profile, planner)
        if law.duration_s > one_by_one_s(velocity, acceleration, target, profile):
            law = _OneByOne(start, target, profile, planner)
        self._law, self._target = law, target
        self.duration_s: float = law.duration_s

    def at(self, t_s: float) -> MotionState:
        """The state `t_s` ≥ 0 after the start; exactly the target once the trajectory has ended."""
        if t_s < self.duration_s:
            return self._law.at(t_s)
        displacement = self._law.at(self.duration_s).displacement
        displacement = plus_times(displacement, self._target, t_s - self.duration_s)
        return MotionState(displacement, self._target, ZERO)


def one_by_one_s(
    velocity: Floats3, acceleration: Floats3, target: Floats3, profile: Profile
) -> float:
    """Time [s] to take the acceleration away and then to go straight to `target`."""
    coast_s = norm(acceleration) / profile.jerk
    change = plus_times(minus(target, velocity), acceleration, -coast_s / 2.0)
    return coast_s + stop_time_s(norm(change), profile.acceleration, profile.jerk)


def coasting(start: MotionState, jerk: float, t_s: float) -> MotionState:
    """The state `t_s` after `start` when the acceleration is taken away with `jerk`."""
    velocity, acceleration = start.velocity, start.acceleration
    coast_s = norm(acceleration) / jerk
    if coast_s <= t_s:
        coasted = plus_times(velocity, acceleration, coast_s / 2.0)
        way = plus_times(times(velocity, coast_s), acceleration, coast_s**2 / 3.0)
        return MotionState(plus_times(way, coasted, t_s - coast_s), coasted, ZERO)
    share = 1.0 - t_s / coast_s  # of the acceleration that is left
    way = plus_times(times(velocity, t_s), acceleration, (2.0 + share) * t_s**2 / 6.0)
    gained = plus_times(velocity, acceleration, (1.0 + share) * t_s / 2.0)
    return MotionState(way, gained, times(acceleration, share))


class _BothAxes:
    """Along the change of velocity and across it at the same time."""

    def __init__(
        self, start: MotionState, target: Floats3, profile: Profile, planner: Planner
    ) -> None:
        self._start, self._target = start, target
        change = minus(target, start.velocity)
        size = norm(change)
        self._along, self._across, a_along, a_across = _plane(change, size, start.acceleration)
        self._trajectory = planner.plan(size, a_along, a_across, profile)
        self.duration_s: float = self._trajectory.duration

    def at(self, t_s: float) -> MotionState:
        if t_s <= 0.0:
            return self._start
        position, velocity, acceleration = self._trajectory.at_time(t_s)
        return MotionState(
            plus(times(self._target, t_s), self._in_plane(position)),
            plus(self._target, self._in_plane(velocity)),
            self._in_plane(acceleration),
        )

    def _in_plane(self, parts: list[float]) -> Floats3:
        return plus_times(times(self._along, parts[0]), self._across, parts[1])


class _OneByOne:
    """First the acceleration is taken away, then the velocity changes along one line."""

    def __init__(
        self, start: MotionState, target: Floats3, profile: Profile, planner: Planner
    ) -> None:
        self._start, self._jerk = start, profile.jerk
        self._coast_s = norm(start.acceleration) / profile.jerk
        self._coasted = coasting(start, profile.jerk, self._coast_s)
        line_start = MotionState.moving(self._coasted.velocity, self._coasted.acceleration)
        self._line = _BothAxes(line_start, target, profile, planner)
        self.duration_s: float = self._coast_s + self._line.duration_s

    def at(self, t_s: float) -> MotionState:
        if t_s <= self._coast_s:
            return coasting(self._start, self._jerk, max(0.0, t_s))
        state = self._line.at(t_s - self._coast_s)
        displacement = plus(self._coasted.displacement, state.displacement)
        return MotionState(displacement, state.velocity, state.acceleration)


def _plane(
    change: Floats3, size: float, acceleration: Floats3
) -> tuple[Floats3, Floats3, float, float]:
    """Unit vectors along the change and across it, and the acceleration's parts on them."""
    a_size = norm(acceleration)
    if size > _TINY:
        along = times(change, 1.0 / size)
    elif a_size > _TINY:
        along = times(acceleration, 1.0 / a_size)
    else:
        along = (1.0, 0.0, 0.0)
    a_along = dot(acceleration, along)
    rest = plus_times(acceleration, along, -a_along)
    a_across = norm(rest)
    if a_across <= _TINY:
        return along, ZERO, a_along, 0.0
    return along, times(rest, 1.0 / a_across), a_along, a_across


def _split(
    change: float, a_along: float, a_across: float, profile: Profile
) -> tuple[list[float], list[float]]:
    """The two axes' accelerations and jerks, split like cosine and sine of an angle.

    The angle is bisected until both axes take equally long.
    """
    least = _LEAST_SHARE * profile.acceleration
    bound = max(_MOST_SHARE * profile.acceleration, math.hypot(a_along, a_across))
    steepest = math.acos(min(1.0, abs(a_along) / bound))
    gentlest = min(math.asin(min(1.0, a_across / bound)), steepest)
    jerk, across = profile.jerk, _THERE_AND_BACK * a_across
    low, high = _LEAST_SPLIT, math.pi / 2 - _LEAST_SPLIT
    for _ in range(_SPLIT_STEPS):
        split = (low + high) / 2.0
        along = cosine = math.cos(split)
        if not gentlest <= split <= steepest:
            along = math.cos(gentlest if split < gentlest else steepest)
        most_along = bound * along * _SLACK
        # across, nothing is to be changed: the limit of the acceleration is never met
        along_s = one_axis_s(
            change, a_along, most_along if most_along > least else least, jerk * cosine
        )
        if along_s < across / (jerk * math.sin(split)):
            low = split
        else:
            high = split
    a_split = min(max(high, gentlest), steepest)
    accelerations = bound * math.cos(a_split) * _SLACK, bound * math.sin(a_split) * _SLACK
    jerks = [jerk * math.cos(high), jerk * math.sin(high)]
    return [max(one, least) for one in accelerations], jerks


def one_axis_s(change: float, start: float, acceleration: float, jerk: float) -> float:
    """The least time [s] for a change of velocity that begins with the acceleration `start`.

    What ruckig takes for one axis, without making its profile.
    """
    if change < start * abs(start) / (2.0 * jerk):  # it must go down first
        change, start = -change, -start
    peak = math.sqrt(max(0.0, jerk * change + start * start / 2.0))
    if peak <= acceleration:
        return (2.0 * peak - start) / jerk
    held = change - (2.0 * acceleration * acceleration - start * start) / (2.0 * jerk)
    return (2.0 * acceleration - start) / jerk + held / acceleration
