"""The arm models that `arm.model` of the configuration may name, and how far each may go."""

from __future__ import annotations

import math
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


def session_boundary(arm: ArmConfig, limits: LimitsConfig) -> TcpBoundary:
    """The workspace's box and `arm.boundary_margin_mm` around it.

    The margin keeps the two apart: the limits stop the arm smoothly at the box, the controller
    stops it with an error if it leaves the box all the same.
    """
    low_z = max(limits.box_min_mm[2], limits.floor_mm)
    return _around((*limits.box_min_mm[:2], low_z), limits.box_max_mm, arm.boundary_margin_mm)


def reach_boundary(arm: ArmConfig, limits: LimitsConfig) -> TcpBoundary:
    """All that the arm reaches above the floor, for the trajectory to the ready pose.

    That may begin anywhere above the table: the factory's home of an arm lies outside many a
    workspace, and the controller, with the session's boundary set, would refuse to move from there.
    """
    most = arm_kind(arm.model).limits
    reach_mm = most.stretched_mm + math.hypot(*arm.tcp_offset_mm_deg[:3])
    floor_mm = min(limits.floor_mm, limits.box_min_mm[2])
    low = (-reach_mm, -reach_mm, floor_mm)
    high = (reach_mm, reach_mm, most.shoulder_mm + reach_mm)
    return _around(low, high, arm.boundary_margin_mm)


def _around(
    low: tuple[float, float, float], high: tuple[float, float, float], margin_mm: float
) -> TcpBoundary:
    """Whole millimetres, away from the middle."""
    from hw.arm import TcpBoundary  # not when the guard process starts

    lower = [math.floor(edge - margin_mm) for edge in low]
    upper = [math.ceil(edge + margin_mm) for edge in high]
    return TcpBoundary((lower[0], lower[1], lower[2]), (upper[0], upper[1], upper[2]))
