"""The limits of a wanted twist: by norm, by frame age, by place, by posture."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from operator import truediv
from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dgesv  # without the 5 µs that numpy takes to get there

from tams_app.config import Config, ProfileConfig
from tams_app.records import ArmKinematics, Twist, Vector
from tams_app.rotation import Rotation
from tams_app.teleop.safety import Reason
from tams_app.teleop.servo import Tcp
from tams_app.teleop.shaping import Admissible, VelocityShaper
from tams_app.teleop.trajectory import Profile
from tams_app.teleop.workspace import RotationCone, Workspace
from tams_app.vectors import ZERO, Floats3, norm, shortened, times

_DEMANDS = (  # below this the hand is at rest [m/s, rad/s]; the limit that may stop it
    (0.005, Reason.WORKSPACE),
    (0.02, Reason.ROTATION_LIMIT),
)
_NOTHING_LEFT = 0.02  # of the wanted speed
_STOPS_WITHIN_S = 0.15  # before a singularity: commands, arm and its reports are up to 60 ms late
_BRAKES_WITHIN_S = 0.08
_MARGIN_M, _MARGIN_RAD = 0.004, 0.02  # from it, where nothing is left of a motion towards it
_STEP_RAD = 0.005
_STILL = 1e-9  # [m/s, rad/s]


class LimitedTwist(NamedTuple):
    """The twist that is allowed, and what took something away."""

    twist: Twist
    joint_scale: float  # 1 unless the posture is near a singularity
    limited_by: Reason | None  # the limit that left next to nothing


def linear_profile(config: ProfileConfig) -> Profile:
    return Profile(config.acceleration_m_s2, config.jerk_m_s3)


def angular_profile(config: ProfileConfig) -> Profile:
    return Profile(config.acceleration_rad_s2, config.jerk_rad_s3)


class _JointLaw(NamedTuple):
    """Joint speeds within this share of their limits, also once so much time has gone."""

    share: float
    stops_within_s: float


_BRAKING = _JointLaw(0.9, _BRAKES_WITHIN_S)
_FOLLOWING = _JointLaw(0.7, _STOPS_WITHIN_S)  # from this share of the limits on the TCP slows down


class Limits:
    """Caps twists, and judges states by whether the arm could still brake in bounds."""

    def __init__(self, config: Config, model: ArmKinematics, ready: Rotation) -> None:
        limits = config.limits
        deadman_s = config.arm.velocity_deadman_s
        self._deadman_s = deadman_s
        self._max_speed = limits.max_speed_mm_s / 1000.0
        self._max_rotation = limits.max_rotation_rad_s
        self._model = model
        self._joint_speeds = model.joint_speed_limits.tolist()
        self._joint_ranges = model.joint_ranges
        self._workspace = Workspace(limits, linear_profile(limits.motion), deadman_s)
        self._cone = RotationCone(limits, angular_profile(limits.motion), deadman_s, ready)
        self.linear = VelocityShaper(
            self._max_speed, linear_profile(limits.motion), linear_profile(limits.stop)
        )
        self.angular = VelocityShaper(
            self._max_rotation, angular_profile(limits.motion), angular_profile(limits.stop)
        )

    def limit(self, wanted: Twist, tcp: Tcp, joints: Vector, scale: float) -> LimitedTwist:
        """`wanted` at the TCP pose and `joints` [rad], all of it slowed by `scale` (0..1)."""
        linear = times(shortened(wanted.linear, self._max_speed), scale)
        angular = times(shortened(wanted.angular, self._max_rotation), scale)
        inside = self._workspace.cap(linear, tcp.position)
        turning = angular
        if any(angular):
            turning = self._cone.cap(angular, self._cone.offset(tcp.rotation))
        joint_scale = min(1.0, self._joint_scale(inside, turning, joints, _FOLLOWING))
        twist = Twist(
            times(shortened(inside, self._max_speed), joint_scale),
            times(shortened(turning, self._max_rotation), joint_scale),
        )
        stopped_by = _what_stopped((linear, angular), (inside, turning), joint_scale)
        return LimitedTwist(twist, joint_scale, stopped_by)

    def shape(self, twist: Twist, tcp: Tcp, joints: Vector, interval_s: float) -> Twist:
        """Follow the limited `twist` smoothly, from a TCP that is at `tcp` now."""
        inside = self._stays_inside(tcp.position, joints)
        linear = self.linear.step(twist.linear, interval_s, inside)
        turned = self._stays_in_cone(tcp.rotation, joints)
        angular = self.angular.step(twist.angular, interval_s, turned)
        return Twist(linear, angular)

    def come_to_rest(self, interval_s: float) -> Twist:
        """The next twist of braking, exactly zero once the arm is at rest."""
        self.linear.brake()
        self.angular.brake()
        return Twist(self.linear.step(ZERO, interval_s), self.angular.step(ZERO, interval_s))

    def reset(self) -> None:
        self.linear.reset()
        self.angular.reset()

    @property
    def at_rest(self) -> bool:
        return self.linear.at_rest and self.angular.at_rest

    @property
    def used_stop_profile(self) -> bool:
        """Whether the last twist was shaped by the stop profile."""
        return self.linear.used_stop_profile or self.angular.used_stop_profile

    def _stays_inside(self, position: Floats3, joints: Vector) -> Admissible:
        def admissible(velocity: Floats3, acceleration: Floats3) -> bool:
            if self._joint_scale(velocity, self.angular.velocity, joints, _BRAKING) < 1.0:
                return False
            reach = self.linear.braking_reach(velocity, acceleration, self._deadman_s)
            if self._workspace.is_far(position, reach):
                return True
            braking = self.linear.braking_trajectory(velocity, acceleration)
            return self._workspace.admits(position, velocity, braking)

        return admissible

    def _stays_in_cone(self, rotation: Rotation, joints: Vector) -> Admissible:
        def admissible(angular: Floats3, acceleration: Floats3) -> bool:
            if self._joint_scale(self.linear.velocity, angular, joints, _BRAKING) < 1.0:
                return False
            offset = self._cone.offset(rotation)
            reach = self.angular.braking_reach(angular, acceleration, self._deadman_s)
            if self._cone.is_far(offset, reach):
                return True
            braking = self.angular.braking_trajectory(angular, acceleration)
            return self._cone.admits(offset, angular, braking)

        return admissible

    def _joint_scale(
        self, linear: Floats3, angular: Floats3, joints: Vector, law: _JointLaw
    ) -> float:
        """The factor by which a twist just keeps `law`, at these joints and on its way.

        The time left at this twist is that until a joint is at its limit, or until a singularity:
        towards one joint speeds grow like 1/√t, so it is where the line through 1/share² now and a
        small step further comes to zero. The scale s is that whose joint speeds are within the
        share once it has gone on for the time that stopping takes:
        (s · share)² = (1 - s · stops_within / left) · law.share².
        """
        if norm(linear) < _STILL and norm(angular) < _STILL:
            return math.inf
        twist = (*linear, *angular)
        speeds = joint_speeds(self._model, twist, joints)
        if speeds is None:
            return 0.0
        share = self._share(speeds)
        step_s = _STEP_RAD / max(map(abs, speeds))
        further = joint_speeds(self._model, twist, joints + step_s * np.array(speeds))
        later = math.inf if further is None else self._share(further)
        closing = (1.0 - (share / later) ** 2) / step_s  # 1 / t, negative away from it
        margin_s = 1.0 / (norm(linear) / _MARGIN_M + norm(angular) / _MARGIN_RAD)
        left_s = [1.0 / closing - margin_s] if closing > 0.0 else []
        left_s += [
            ((high if speed > 0.0 else low) - at) / speed
            for at, speed, (low, high) in zip(
                joints.tolist(), speeds, self._joint_ranges, strict=True
            )
            if speed
        ]
        least_s = min(left_s)
        if least_s <= 0.0:
            return 0.0
        half = law.stops_within_s / least_s / 2.0
        return 1.0 / (half + math.hypot(half, share / law.share))

    def _share(self, speeds: Iterable[float]) -> float:
        """The largest share of the joints' speed limits."""
        share: float = max(map(truediv, map(abs, speeds), self._joint_speeds))
        return share


def joint_speeds(
    model: ArmKinematics, twist: Sequence[float], joints: Vector
) -> list[float] | None:
    """The joint speeds [rad/s] that give `twist` [m/s, rad/s] at `joints` [rad]; None: none do."""
    *_, solution, failed = dgesv(model.jacobian(joints), twist)
    speeds: list[float] = solution.tolist()
    return None if failed or not all(map(math.isfinite, speeds)) else speeds


def _what_stopped(
    wanted: tuple[Floats3, Floats3], left: tuple[Floats3, Floats3], joint_scale: float
) -> Reason | None:
    """The limit that left next to nothing of the linear or the angular velocity."""
    for demand, rest, (least, bound) in zip(wanted, left, _DEMANDS, strict=True):
        demanded = norm(demand)
        if demanded < least:
            continue
        if joint_scale <= _NOTHING_LEFT:
            return Reason.SINGULARITY
        if norm(rest) <= _NOTHING_LEFT * demanded:
            return bound
    return None
