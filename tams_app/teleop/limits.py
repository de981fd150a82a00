"""What is left of a wanted twist: by norm, by frame age, by place, by posture."""

from __future__ import annotations

import math
from operator import truediv
from typing import NamedTuple

from scipy.linalg.lapack import dgesv  # without the 5 µs that numpy takes to get there

from tams_app.config import Config, ProfileConfig
from tams_app.records import Twist, Vector
from tams_app.rotation import Rotation
from tams_app.teleop.records import ArmModel
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


class LimitedTwist(NamedTuple):
    """The twist that is allowed, and what took something away."""

    twist: Twist
    joint_scale: float  # 1 unless the posture is near a singularity
    limited_by: Reason | None  # the limit that left next to nothing


def linear_profile(config: ProfileConfig) -> Profile:
    return Profile(config.acceleration_m_s2, config.jerk_m_s3)


def angular_profile(config: ProfileConfig) -> Profile:
    return Profile(config.acceleration_rad_s2, config.jerk_rad_s3)


class Limits:
    """Caps twists, and judges states by whether the arm could still brake in bounds."""

    def __init__(self, config: Config, model: ArmModel, ready: Rotation) -> None:
        limits = config.limits
        deadman_s = config.arm.velocity_deadman_s
        self._deadman_s = deadman_s
        self._max_speed = limits.max_speed_mm_s / 1000.0
        self._max_rotation = limits.max_rotation_rad_s
        self._joint_share = limits.singularity_scale_from
        self._model = model
        self._joint_speeds = model.joint_speed_limits.tolist()
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
        joint_scale = self._joint_scale(inside, turning, joints)
        twist = Twist(
            times(shortened(inside, self._max_speed), joint_scale),
            times(shortened(turning, self._max_rotation), joint_scale),
        )
        stopped_by = _what_stopped((linear, angular), (inside, turning), joint_scale)
        return LimitedTwist(twist, joint_scale, stopped_by)

    def shape(self, twist: Twist, tcp: Tcp, interval_s: float) -> Twist:
        """Follow the limited `twist` smoothly, from a TCP that is at `tcp` now."""
        linear = self.linear.step(twist.linear, interval_s, self._stays_inside(tcp.position))
        angular = self.angular.step(twist.angular, interval_s, self._stays_in_cone(tcp.rotation))
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

    def _stays_inside(self, position: Floats3) -> Admissible:
        def admissible(velocity: Floats3, acceleration: Floats3) -> bool:
            reach = self.linear.braking_reach(velocity, acceleration, self._deadman_s)
            if self._workspace.is_far(position, reach):
                return True
            braking = self.linear.braking_trajectory(velocity, acceleration)
            return self._workspace.admits(position, velocity, braking)

        return admissible

    def _stays_in_cone(self, rotation: Rotation) -> Admissible:
        def admissible(angular: Floats3, acceleration: Floats3) -> bool:
            offset = self._cone.offset(rotation)
            reach = self.angular.braking_reach(angular, acceleration, self._deadman_s)
            if self._cone.is_far(offset, reach):
                return True
            braking = self.angular.braking_trajectory(angular, acceleration)
            return self._cone.admits(offset, angular, braking)

        return admissible

    def _joint_scale(self, linear: Floats3, angular: Floats3, joints: Vector) -> float:
        """Keeps the predicted largest joint speed within its share of the limit."""
        if not (any(linear) or any(angular)):
            return 1.0
        *_, solution, failed = dgesv(self._model.jacobian(joints), (*linear, *angular))
        speeds = solution.tolist()
        if failed or not all(map(math.isfinite, speeds)):  # no joint speed gives this twist
            return 0.0
        share = max(map(truediv, map(abs, speeds), self._joint_speeds))
        return 1.0 if share <= self._joint_share else self._joint_share / share


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
