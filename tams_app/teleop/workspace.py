"""Where the TCP may be (box, floor, ring about the base axis) and how it may turn (a cone).

One law for both. From inside, it never leaves: the outward speed is capped so that it shrinks
smoothly to zero, and a state is admissible only if braking from it, after the deadman time in which
the arm may still follow the last command, ends inside. From outside, nothing leads further out;
inward is always free.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from operator import gt
from typing import NamedTuple

from tams_app.config import LimitsConfig
from tams_app.rotation import Rotation
from tams_app.teleop.trajectory import Profile, VelocityTrajectory
from tams_app.vectors import ZERO, Floats3, dot, norm, plus, plus_times, times

_INSET_M = 5e-4  # the cap's bounds lie inside the hard ones: room for rounding and sampling
_INSET_RAD = 2e-3
_TOLERANCE = 1e-9
_REACTION_S = 0.02  # a cap that moves is followed this much later
_TURNING_S = 0.1  # how far ahead a curved bound is turned along
_BRAKING_SAMPLES = 8
_NEAR_AXIS_M = 1e-6


class OutwardCap(NamedTuple):
    """The outward speed allowed at a distance from a bound: what a gentle stop there permits."""

    acceleration: float
    delay_s: float  # deadman time, jerk phase and reaction
    gain_per_s: float  # slope of the slow-down near the bound; inf for none

    def at(self, distance: float) -> float:
        """The speed [m/s, rad/s] allowed at `distance` [m, rad]; zero on and beyond the bound."""
        if distance <= 0.0:
            return 0.0
        root = math.sqrt(self.delay_s**2 + 2.0 * distance / self.acceleration)
        return min(self.gain_per_s * distance, self.acceleration * (root - self.delay_s))


def _cap(profile: Profile, deadman_s: float, gain_per_s: float) -> OutwardCap:
    delay_s = deadman_s + profile.acceleration / (2.0 * profile.jerk) + _REACTION_S
    return OutwardCap(profile.acceleration, delay_s, gain_per_s)


class Workspace:
    """Box, floor and ring, in metres, in the arm's base frame."""

    def __init__(self, limits: LimitsConfig, motion: Profile, deadman_s: float) -> None:
        x, y, z = (edge / 1000.0 for edge in limits.box_min_mm)
        self._low = x, y, max(z, limits.floor_mm / 1000.0)
        x, y, z = (edge / 1000.0 for edge in limits.box_max_mm)
        self._high = x, y, z
        self._radius_min = limits.radius_min_mm / 1000.0
        self._radius_max = limits.radius_max_mm / 1000.0
        self._deadman_s = deadman_s
        gain_per_s = limits.max_speed_mm_s / limits.slow_down_mm
        self._outward = _cap(motion, deadman_s, gain_per_s)

    def excess(self, position: Floats3) -> tuple[float, ...]:
        """The distance [m] of a position beyond each of the 8 bounds, negative inside.

        Lower and upper edges of the box along x, y, z, then the inner and outer radius.
        """
        x, y, z = position
        (low_x, low_y, low_z), (high_x, high_y, high_z) = self._low, self._high
        radius = math.hypot(x, y)
        return (
            low_x - x,
            low_y - y,
            low_z - z,
            x - high_x,
            y - high_y,
            z - high_z,
            self._radius_min - radius,
            radius - self._radius_max,
        )

    def cap(self, velocity: Floats3, position: Floats3) -> Floats3:
        """`velocity` [m/s] with its outward components capped for a TCP at `position` [m]."""
        if not any(velocity):
            return velocity
        edges = zip(velocity, position, self._low, self._high, strict=True)
        x, y, z = (self._cap_axis(*edge) for edge in edges)
        return self._cap_radial((x, y, z), position)

    def _cap_axis(self, speed: float, place: float, low: float, high: float) -> float:
        if speed > 0.0:
            return min(speed, self._outward.at(high - place - _INSET_M))
        return max(speed, -self._outward.at(place - low - _INSET_M)) if speed < 0.0 else speed

    def _cap_radial(self, velocity: Floats3, position: Floats3) -> Floats3:
        radius = math.hypot(position[0], position[1])
        if radius < _NEAR_AXIS_M:
            return velocity
        normal = (position[0] / radius, position[1] / radius, 0.0)
        radial = dot(velocity, normal)
        flat_squared = velocity[0] * velocity[0] + velocity[1] * velocity[1]
        around_squared = max(0.0, flat_squared - radial * radial)
        to_wall = self._radius_max - radius - _INSET_M
        outermost = self._outward.at(to_wall)
        if to_wall < _TURNING_S * math.sqrt(around_squared):
            outermost -= around_squared / radius * _TURNING_S
        innermost = -self._outward.at(radius - self._radius_min - _INSET_M)
        return plus_times(velocity, normal, min(max(radial, innermost), outermost) - radial)

    def is_far(self, position: Floats3, reach: float) -> bool:
        """Whether `position` is further than `reach` [m] from every bound, inside."""
        return max(self.excess(position)) < -reach

    def admits(self, position: Floats3, velocity: Floats3, braking: VelocityTrajectory) -> bool:
        """Whether a TCP at `position` that got `velocity` stays in bounds while it brakes."""
        now = self.excess(position)
        most = [max(excess, 0.0) + _TOLERANCE for excess in now]
        outside = [bound for bound, excess in enumerate(now) if excess > 0.0]
        way = list(_displacements(braking))
        # Braking may begin at once or when the deadman time is over: for plane bounds the two
        # cover all between, for the ring the inset does.
        for held in (ZERO, times(velocity, self._deadman_s)):
            begin = plus(position, held)
            before: tuple[float, ...] | None = None
            for displacement in way:
                excess = self.excess(plus(begin, displacement))
                if any(map(gt, excess, most)):
                    return False
                if before and any(excess[n] > before[n] + _TOLERANCE for n in outside):
                    return False
                before = excess
        return True


class RotationCone:
    """The largest angle between the TCP's orientation and the ready orientation."""

    def __init__(
        self, limits: LimitsConfig, motion: Profile, deadman_s: float, ready: Rotation
    ) -> None:
        self._angle = math.radians(limits.cone_deg)
        self._ready = ready
        self._deadman_s = deadman_s
        self._outward = _cap(motion, deadman_s, math.inf)

    def offset(self, rotation: Rotation) -> Floats3:
        """Rotation vector [rad] from the ready orientation, in the base frame."""
        return self._ready.turn_to(rotation)

    def cap(self, angular: Floats3, offset: Floats3) -> Floats3:
        """`angular` [rad/s] with the component that leads away from ready capped."""
        angle = norm(offset)
        if angle < _TOLERANCE:
            return angular
        normal = times(offset, 1.0 / angle)
        outward = dot(angular, normal)
        across_squared = max(0.0, dot(angular, angular) - outward * outward)
        to_wall = self._angle - angle - _INSET_RAD
        outermost = self._outward.at(to_wall)
        if to_wall < _TURNING_S * math.sqrt(across_squared):
            outermost -= across_squared / math.tan(min(angle, 1.5)) * _TURNING_S
        return plus_times(angular, normal, min(outward, outermost) - outward)

    def is_far(self, offset: Floats3, reach: float) -> bool:
        """Whether turning by `reach` [rad] stays inside, whatever the axis."""
        return norm(offset) + reach < self._angle

    def admits(self, offset: Floats3, angular: Floats3, braking: VelocityTrajectory) -> bool:
        """Whether a TCP that is turned by `offset` and got `angular` stays in while it brakes."""
        held = times(angular, self._deadman_s)
        now = norm(offset)
        bound = max(self._angle, now) + _TOLERANCE
        for turn in _displacements(braking):
            for whole in (turn, plus(turn, held)):
                if _angle_after(offset, now, whole) > bound:
                    return False
        return True


def _displacements(braking: VelocityTrajectory) -> Iterator[Floats3]:
    """The displacements of a trajectory from its start, at a few instants of it."""
    for sample in range(_BRAKING_SAMPLES + 1):
        yield braking.at(braking.duration_s * sample / _BRAKING_SAMPLES).displacement


def _angle_after(offset: Floats3, angle: float, turn: Floats3) -> float:
    """Angle [rad] of the rotation `turn` after `offset`, both rotation vectors."""
    turn_angle = norm(turn)
    if turn_angle < _TOLERANCE or angle < _TOLERANCE:
        return turn_angle + angle
    cosine = dot(turn, offset) / (turn_angle * angle)
    half = math.cos(turn_angle / 2) * math.cos(angle / 2)
    half -= math.sin(turn_angle / 2) * math.sin(angle / 2) * cosine
    return 2.0 * math.acos(min(1.0, abs(half)))
