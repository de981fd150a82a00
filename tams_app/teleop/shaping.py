"""Follows a target velocity smoothly: speed, acceleration and jerk hold as norms, not per axis."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from tams_app.teleop.trajectory import (
    MotionState,
    Planner,
    Profile,
    VelocityTrajectory,
    coasting,
    one_by_one_s,
)
from tams_app.vectors import ZERO, Floats3, norm, plus_times

Admissible = Callable[[Floats3, Floats3], bool]

_SLACK = 1.0 + 1e-9  # rounding must not put the present state outside its own limits


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
        self._planner = Planner()
        self._braking: VelocityTrajectory | None = None
        self._braking_for_s = 0.0
        self.used_stop_profile = False  # in the last step
        self.velocity = ZERO
        self.acceleration = ZERO

    @property
    def braking(self) -> bool:
        """Whether it is coming to rest and will not follow a target before."""
        return self._braking is not None

    @property
    def at_rest(self) -> bool:
        return not (self.braking or any(self.velocity) or any(self.acceleration))

    def reset(self) -> None:
        """At rest at once: the arm was stopped by other means."""
        self._braking = None
        self.velocity = self.acceleration = ZERO

    def brake(self) -> None:
        """Come to rest within the stop profile, whatever target follows."""
        if self._braking is None and not self.at_rest:
            self._begin_braking()

    def braking_trajectory(self, velocity: Floats3, acceleration: Floats3) -> VelocityTrajectory:
        """The trajectory by which `brake` would come to rest from that state."""
        return VelocityTrajectory(velocity, acceleration, ZERO, self._stop, self._planner)

    def braking_reach(self, velocity: Floats3, acceleration: Floats3, held_s: float) -> float:
        """An upper bound of the distance [m, rad] of `held_s` at that velocity, then braking.

        No trajectory is slower than `one_by_one_s` or accelerates harder than the profile: the
        speed never exceeds what can both be gained from the start and be lost until the end.
        """
        stop, speed = self._stop, norm(velocity)
        rest_s = one_by_one_s(velocity, acceleration, ZERO, stop)
        peak = (speed + stop.acceleration * rest_s) / 2.0
        return speed * held_s + (2.0 * peak**2 - speed**2) / (2.0 * stop.acceleration)

    def step(
        self, target: Floats3, interval_s: float, admissible: Admissible | None = None
    ) -> Floats3:
        """Advance by `interval_s` towards `target`, and return the velocity.

        `admissible(velocity, acceleration)` tells whether braking from there stays in bounds; a
        state that does not pass is never taken on unless braking itself leads there. None: all are.
        """
        self.used_stop_profile = self._braking is not None
        if self._braking is not None:
            self._advance_braking(self._braking, interval_s)
        elif any(target) or not self.at_rest:
            self._advance(target, interval_s, admissible)
        return self.velocity

    def _advance(self, target: Floats3, interval_s: float, admissible: Admissible | None) -> None:
        for state in self._ways_on(target, interval_s):
            if self._keeps_profile(state) and (
                admissible is None or admissible(state.velocity, state.acceleration)
            ):
                self.velocity, self.acceleration = state.velocity, state.acceleration
                return
        self.used_stop_profile = True
        self._advance_braking(self._begin_braking(), interval_s)

    def _ways_on(self, target: Floats3, interval_s: float) -> Iterator[MotionState]:
        """Towards the target; if that may not be, without acceleration."""
        velocity, acceleration = self.velocity, self.acceleration
        plan = VelocityTrajectory(velocity, acceleration, target, self._motion, self._planner)
        yield plan.at(interval_s)
        present = MotionState.moving(velocity, acceleration)
        yield coasting(present, self._motion.jerk, interval_s)

    def _begin_braking(self) -> VelocityTrajectory:
        self._braking = self.braking_trajectory(self.velocity, self.acceleration)
        self._braking_for_s = 0.0
        return self._braking

    def _advance_braking(self, trajectory: VelocityTrajectory, interval_s: float) -> None:
        self._braking_for_s += interval_s
        state = trajectory.at(self._braking_for_s)
        self.velocity, self.acceleration = state.velocity, state.acceleration
        if self._braking_for_s >= trajectory.duration_s:
            self.reset()

    def _keeps_profile(self, state: MotionState) -> bool:
        """The norm is convex, so it is largest at an end of the coasting that could follow."""
        bound = self._max_speed * _SLACK
        size = norm(state.acceleration)
        if size > self._motion.acceleration * _SLACK:
            return False
        time_s = size / self._motion.jerk
        coasted = plus_times(state.velocity, state.acceleration, time_s / 2.0)
        return norm(state.velocity) <= bound and norm(coasted) <= bound
