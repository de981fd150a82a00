"""A session's checks of its configuration, and its devices and control loop."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from hw.arms import arm_kind, check_limits
from hw.make_camera import NOT_LIVE, SOURCES
from hw.make_controller import DEVICES
from tams_app.config import Config
from tams_app.config.whole import REMOVED
from tams_app.errors import ConfigError, not_one_of
from tams_app.policy.allocation import STRATEGIES
from tams_app.policy.budget import BUDGETS
from tams_app.policy.inference import INFERENCES
from tams_app.records import Pose
from tams_app.robot.control import ControlLoop, LoopDevices, Observer, Signals
from tams_app.robot.devices import Devices
from tams_app.robot.listener import Listener
from tams_app.runtime.clock import Clock
from tams_app.teleop.drive import POSE_GAIN_PER_S
from tams_app.teleop.hands import SIMULATED
from tams_app.teleop.limits import linear_profile
from tams_app.teleop.loop import Teleop
from tams_app.teleop.workspace import Workspace
from tams_app.vectors import floats
from tams_app.video.live.networks import resolve_network

# of `Workspace.excess`, in its order
_BOUNDS = (
    "box_min_mm",
    "box_min_mm",
    "floor_mm or box_min_mm",
    "box_max_mm",
    "box_max_mm",
    "box_max_mm",
    "radius_min_mm",
    "radius_max_mm",
)


def check_names(config: Config) -> None:
    """ConfigError for a word that stands for nothing, before anything is made of it."""
    STRATEGIES[config.strategy](config.policy)
    _ = BUDGETS[config.policy.budget.mode], INFERENCES[config.policy.phases.inference]
    resolve_network(config, config.network)
    check_hand(config)
    for camera in config.cameras.values():
        _ = SOURCES[camera.source]


def check_hand(config: Config) -> None:
    """ConfigError if the operator's device does not exist."""
    device = config.controller.device
    if device not in (known := ("auto", *DEVICES, SIMULATED)):
        reason = REMOVED.get(device) or not_one_of(device, known)
        raise ConfigError(f"controller.device: {reason}")


def check_ready_pose(config: Config) -> None:
    """ConfigError unless the arm can do what is configured, beginning at its ready pose.

    Its model is known, the limits are within its own, and the ready pose is in the workspace.
    """
    limits = config.limits
    check_limits(config.arm, limits)
    _check_leashes(config)
    ready = ready_pose(config).position
    workspace = Workspace(limits, linear_profile(limits.motion), config.arm.velocity_deadman_s)
    beyond = workspace.excess(floats(ready))
    most = max(beyond)
    if most > 0.0:
        where = ", ".join(str(round(value * 1000)) for value in ready)
        raise ConfigError(
            f"arm.ready_joints_deg puts the fingertips at ({where}) mm, "
            f"{most * 1000:.0f} mm outside limits.{_BOUNDS[beyond.index(most)]}: "
            "change one of the two"
        )


def _check_leashes(config: Config) -> None:
    """ConfigError if at its leash the position loop leaves the hand nothing of the speed limit.

    The lag of an arm that stands still would then not grow, and it would not be noticed.
    """
    limits = config.limits
    for leash, speed in (("leash_mm", "max_speed_mm_s"), ("leash_rad", "max_rotation_rad_s")):
        most = getattr(limits, speed) / POSE_GAIN_PER_S
        if getattr(limits, leash) >= most:
            raise ConfigError(
                f"limits.{leash} must be below limits.{speed} / {POSE_GAIN_PER_S:g}, {most:.3g}, "
                "or an arm that stands still is not noticed"
            )


def check_views(config: Config, dry_run: bool) -> None:
    """ConfigError for a real arm with a view that does not show it; a dry run moves nothing."""
    if config.rig.enabled or dry_run:
        return
    for view in config.video.views:
        source = config.cameras[view].source
        if source in NOT_LIVE:
            raise ConfigError(
                f"cameras.{view}.source is {source}, which does not show the arm that would move: "
                "give the view a camera, or add --dry-run"
            )


def devices(config: Config, clock: Clock, log_directory: Path) -> Devices:
    """The rig's devices, or the hardware that the configuration names."""
    if config.rig.enabled:
        from tams_app.robot.rig import SimulatedRig  # hardware runs without the simulation

        return SimulatedRig(config, clock, log_directory)
    return Devices(config, clock)


def control_loop(
    config: Config,
    clock: Clock,
    loop_devices: LoopDevices,
    delay_ns: int,
    signals: Signals,
    listeners: Sequence[Listener] = (),
    observers: Sequence[Observer] = (),
) -> ControlLoop:
    """The loop with the configured teleoperation and phase inference.

    `delay_ns`: no frame of its video is ever shown younger: one-way latency plus jitter buffer.
    """
    return ControlLoop(
        config,
        clock,
        loop_devices,
        signals,
        teleop(config, delay_ns),
        INFERENCES[config.policy.phases.inference](config.policy.phases),
        listeners,
        observers,
    )


def teleop(config: Config, delay_ns: int) -> Teleop:
    """Clutch to limits, for the arm with the configured tool; `delay_ns` of the frames."""
    kinematics = arm_kind(config.arm.model).kinematics(config.arm)
    return Teleop(config, kinematics, ready_pose(config).rotation, delay_ns)


def ready_pose(config: Config) -> Pose:
    joints = np.radians(np.array(config.arm.ready_joints_deg))
    return arm_kind(config.arm.model).kinematics(config.arm).tcp_pose(joints)
