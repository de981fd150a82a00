"""The arm models that `arm.model` of the configuration may name."""

from __future__ import annotations

import pkgutil
from typing import TYPE_CHECKING

from tams_app.errors import ConfigError
from tams_app.registry import Registry

if TYPE_CHECKING:  # the guard process starts without the configuration's libraries
    from hw.arm import ArmKind, Plant, SimulatedArm, TcpBoundary
    from tams_app.config import ArmConfig, LimitsConfig
    from tams_app.records import Vector
    from tams_app.runtime.clock import Clock

ARM_KINDS: Registry[ArmKind] = Registry("arm.model", "tams.arms", {"lite6": "hw.lite6.kind:KIND"})
"""Kinds of arm by their word for `arm.model`; entry points of `tams.arms`."""


def arm_kind(model: str) -> ArmKind:
    """The kind of arm that the configuration calls `model`.

    Args:
        model: a key of `ARM_KINDS`.

    Returns:
        The kind, whose module is imported by this.

    Raises:
        ConfigError: there is no such model; the sentence names those there are.
    """
    return ARM_KINDS[model]


def simulated_arm(
    config: ArmConfig,
    clock: Clock,
    joints: Vector,
    boundary: TcpBoundary | None,
    plant: Plant | None = None,
    gripper_closed: bool | None = None,
) -> SimulatedArm:
    """Make a simulated arm in this process, for virtual time and dry runs.

    Args:
        config: `arm` of the configuration, with its `model`.
        clock: the time that the simulation follows.
        joints: where it stands [rad], shape (6,).
        boundary: set in the controller on connecting; None leaves the controller's as it is.
        plant: what follows the joint targets; None: joints that are there at once.
        gripper_closed: what the gripper was commanded before; None: nothing.

    Returns:
        The arm, not connected yet.

    Raises:
        ConfigError: there is no such model.
    """
    make = pkgutil.resolve_name(arm_kind(config.model).simulation)
    arm: SimulatedArm = make(config, clock, joints, boundary, plant, gripper_closed)
    return arm


def check_limits(arm: ArmConfig, limits: LimitsConfig) -> None:
    """ConfigError for an unknown model, or for a configuration beyond what the arm can do."""
    kind = arm_kind(arm.model)
    most = kind.limits
    ranges = zip(most.joint_lower_deg, most.joint_upper_deg, strict=True)
    for number, (joint, (lower, upper)) in enumerate(
        zip(arm.ready_joints_deg, ranges, strict=True), start=1
    ):
        if not lower <= joint <= upper:
            raise ConfigError(
                f"arm.ready_joints_deg: joint {number} turns from {lower:g} to {upper:g} degrees, "
                f"not to {joint:g}"
            )
    for key, value, bound in (
        ("max_speed_mm_s", limits.max_speed_mm_s, most.tcp_speed_mm_s),
        ("max_rotation_rad_s", limits.max_rotation_rad_s, most.joint_speed_rad_s),
        ("radius_max_mm", limits.radius_max_mm, most.reach_mm),
        (
            "stop.acceleration_m_s2",  # never below that of motion
            limits.stop.acceleration_m_s2,
            most.tcp_acceleration_mm_s2 / 1000,
        ),
    ):
        if value > bound:
            raise ConfigError(
                f"limits.{key} is {value:g}: the {kind.title} allows at most {bound:g}"
            )
