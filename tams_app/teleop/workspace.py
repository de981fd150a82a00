"""Where the TCP may be (box, floor, ring about the base axis) and how it may turn (a cone).

One law for both. From inside, it never leaves: the outward speed is capped so that it shrinks
smoothly to zero, and a state is admissible only if braking from it, after the deadman time in which
the arm may still follow the last command, ends inside. From outside, nothing leads further out;
inward is always free.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tams_app.config import LimitsConfig
from tams_app.records import Vector
from tams_app.rotation import Rotation
from tams_app.teleop.trajectory import Profile, VelocityTrajectory

_INSET_M = 5e-4  # the cap's bounds lie inside the hard ones: room for rounding and sampling
_INSET_RAD = 2e-3
_TOLERANCE = 1e-9
_REACTION_S = 0.02  # a cap that moves is followed this much later
_TURNING_S = 0.1  # how far ahead a curved bound is turned along
_BRAKING_SAMPLES = 8
_NEAR_AXIS_M = 1e-6


@dataclass(frozen=True, slots=True)
class OutwardCap:
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
        self._low = np.array(limits.box_min_mm) / 1000.0
        self._low[2] = max(self._low[2], limits.floor_mm / 1000.0)
        self._high = np.array(limits.box_max_mm) / 1000.0
        self._radius_min = limits.radius_min_mm / 1000.0
        self._radius_max = limits.radius_max_mm / 1000.0
        self._deadman_s = deadman_s
        gain_per_s = limits.max_speed_mm_s / limits.slow_down_mm
        self._outward = _cap(motion, deadman_s, gain_per_s)

    def excess(self, positions: NDArray[np.float64]) -> NDArray[np.float64]:
        """How far outside each bound [m], negative inside: (n, 3) positions to (n, 8)."""
        radius = np.hypot(positions[:, 0], positions[:, 1])
        return np.column_stack(
            (
                self._low - positions,
                positions - self._high,
                self._radius_min - radius,
                radius - self._radius_max,
            )
        )

    def cap(self, velocity: Vector, position: Vector) -> Vector:
        """`velocity` [m/s] with its outward components capped for a TCP at `position` [m]."""
        allowed_low = [-self._outward.at(float(d) - _INSET_M) for d in position - self._low]
        allowed_high = [self._outward.at(float(d) - _INSET_M) for d in self._high - position]
        capped: Vector = np.minimum(np.maximum(velocity, allowed_low), allowed_high)
        return self._cap_radial(capped, position)

    def _cap_radial(self, velocity: Vector, position: Vector) -> Vector:
        radius = math.hypot(position[0], position[1])
        if radius < _NEAR_AXIS_M:
            return velocity
        normal = np.array([position[0] / radius, position[1] / radius, 0.0])
        radial = float(velocity @ normal)
        around_squared = max(0.0, float(velocity[:2] @ velocity[:2]) - radial**2)
        to_wall = self._radius_max - radius - _INSET_M
        outermost = self._outward.at(to_wall)
        if to_wall < _TURNING_S * math.sqrt(around_squared):
            outermost -= around_squared / radius * _TURNING_S
        innermost = -self._outward.at(radius - self._radius_min - _INSET_M)
        return velocity + (min(max(radial, innermost), outermost) - radial) * normal

    def is_far(self, position: Vector, reach: float) -> bool:
        """Whether `position` is further than `reach` [m] from every bound, inside."""
        return bool(self.excess(position[np.newaxis]).max() < -reach)

    def admits(self, position: Vector, velocity: Vector, braking: VelocityTrajectory) -> bool:
        """Whether a TCP at `position` that got `velocity` stays in bounds while it brakes."""
        held = velocity * self._deadman_s
        now = self.excess(position[np.newaxis])[0]
        travelled = position + _displacements(braking)
        # Braking may begin at once or when the deadman time is over: for plane bounds the two
        # cover all between, for the ring the inset does.
        excess = np.stack((self.excess(travelled), self.excess(travelled + held)))
        stays_in = excess.max(axis=(0, 1)) <= np.maximum(now, 0.0) + _TOLERANCE
        never_outward = np.diff(excess, axis=1).max(axis=(0, 1)) <= _TOLERANCE
        return bool((stays_in & (never_outward | (now <= 0.0))).all())


class RotationCone:
    """The largest angle between the TCP's orientation and the ready orientation."""

    def __init__(
        self, limits: LimitsConfig, motion: Profile, deadman_s: float, ready: Rotation
    ) -> None:
        self._angle = math.radians(limits.cone_deg)
        self._ready = ready
        self._deadman_s = deadman_s
        self._outward = _cap(motion, deadman_s, math.inf)

    def offset(self, rotation: Rotation) -> Vector:
        """Rotation vector [rad], shape (3,), from the ready orientation, in the base frame."""
        return np.array(self._ready.turn_to(rotation))

    def cap(self, angular: Vector, offset: Vector) -> Vector:
        """`angular` [rad/s] with the component that leads away from ready capped."""
        angle = math.sqrt(float(offset @ offset))
        if angle < _TOLERANCE:
            return angular
        normal = offset / angle
        outward = float(angular @ normal)
        across_squared = max(0.0, float(angular @ angular) - outward**2)
        to_wall = self._angle - angle - _INSET_RAD
        outermost = self._outward.at(to_wall)
        if to_wall < _TURNING_S * math.sqrt(across_squared):
            outermost -= across_squared / math.tan(min(angle, 1.5)) * _TURNING_S
        return angular + (min(outward, outermost) - outward) * normal

    def is_far(self, offset: Vector, reach: float) -> bool:
        """Whether turning by `reach` [rad] stays inside, whatever the axis."""
        return math.sqrt(float(offset @ offset)) + reach < self._angle

    def admits(self, offset: Vector, angular: Vector, braking: VelocityTrajectory) -> bool:
        """Whether a TCP that is turned by `offset` and got `angular` stays in while it brakes."""
        held = angular * self._deadman_s
        now = math.sqrt(float(offset @ offset))
        bound = max(self._angle, now) + _TOLERANCE
        for turn in _displacements(braking):
            for whole in (turn, turn + held):
                if _angle_after(offset, now, whole) > bound:
                    return False
        return True


def _displacements(braking: VelocityTrajectory) -> NDArray[np.float64]:
    """Where braking leads, relative to its start, (samples, 3)."""
    samples = range(_BRAKING_SAMPLES + 1)
    times_s = [braking.duration_s * sample / _BRAKING_SAMPLES for sample in samples]
    return np.array([braking.at(t_s).displacement for t_s in times_s])


def _angle_after(offset: Vector, angle: float, turn: Vector) -> float:
    """Angle [rad] of the rotation `turn` after `offset`, both rotation vectors."""
    turn_angle = math.sqrt(float(turn @ turn))
    if turn_angle < _TOLERANCE or angle < _TOLERANCE:
        return turn_angle + angle
    cosine = float(turn @ offset) / (turn_angle * angle)
    half = math.cos(turn_angle / 2) * math.cos(angle / 2)
    half -= math.sin(turn_angle / 2) * math.sin(angle / 2) * cosine
    return 2.0 * math.acos(min(1.0, abs(half)))
