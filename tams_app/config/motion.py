"""The arm, the hand that moves it, and the limits of both.

What the arm itself allows at most is checked against its model (`hw.arms.check_limits`).
"""

from __future__ import annotations

import math
from typing import Annotated, Self

import numpy as np
from pydantic import Field, field_validator, model_validator

from tams_app.config.section import (
    Finite,
    NonNegative,
    Port,
    Positive,
    Section,
    Six,
    Triple,
)

MAX_STOP_TIME_S = 0.1
MAX_TOOL_LENGTH_MM = 300.0


def stop_time_s(speed: float, acceleration: float, jerk: float) -> float:
    """Time [s] from `speed` [m/s] to rest under `acceleration` [m/s²] and `jerk` [m/s³]."""
    if speed < acceleration**2 / jerk:
        return 2.0 * math.sqrt(speed / jerk)
    return speed / acceleration + acceleration / jerk


def longest_stop_s(speed: float, gained: float, acceleration: float, jerk: float) -> float:
    """Time [s] in which any motion of at most `speed` and acceleration `gained` comes to rest.

    A release may come while the arm still speeds up, so that acceleration has to go first; what it
    adds meanwhile stays within `speed`, because the shaping lets no acceleration grow that could
    not die out below it. Then the arm stops from full speed at worst. (`teleop/trajectory.py` is
    never slower than this order.)
    """
    return gained / jerk + stop_time_s(speed, acceleration, jerk)


def check_rotation(key: str, rows: tuple[Triple, Triple, Triple]) -> None:
    """ValueError unless `rows` are a proper rotation."""
    matrix = np.array(rows)
    if not np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-6):
        raise ValueError(f"{key} must be orthonormal")
    if np.linalg.det(matrix) < 0:
        raise ValueError(
            f"{key} is mirrored (determinant -1): one of its rows has the wrong sign; "
            "docs/OPERATOR.md has the usual four"
        )


class GuardConfig(Section):
    """The helper process that stops the arm when the control loop falls silent."""

    heartbeat_timeout_ms: Annotated[float, Field(ge=20, le=1000)] = 100.0
    """Silence of the control loop after which the guard stops the arm."""


class ArmConfig(Section):
    """The arm and how it is reached."""

    model: str = "lite6"
    """The kind of arm: a name of `hw.arms.ARM_KINDS`."""
    host: str = "127.0.0.1"
    """Name or address of the control box."""
    control_port: Port = 502
    """TCP port of the commands."""
    report_port: Port = 30001
    """TCP port of the normal report; the rich and the real-time one, which are read, follow it."""
    velocity_deadman_s: Annotated[float, Field(gt=0, le=1)] = 0.1
    """The control box stops the arm this long after the last twist; docs/SAFETY.md has 0.1."""
    reply_timeout_s: Annotated[float, Field(gt=0, le=1)] = 0.04
    """How long a reply may take; two missing in a row are a fault, within 100 ms, tick and all."""
    tcp_offset_mm_deg: Six = (0, 0, 82, 0, 0, 0)
    """From the flange to the fingertips: x, y, z, roll, pitch, yaw; at most 300 mm."""
    tcp_load_kg: Annotated[float, Field(ge=0, le=1)] = 0.35
    """Mass of all that the flange carries but for the block."""
    tcp_load_centre_mm: Triple = (0, 0, 40)
    """Centre of that mass from the flange: x, y, z; at most 300 mm."""
    collision_sensitivity: Annotated[int, Field(ge=1, le=5)] = 3
    """Of the control box's collision detection: 1 is the least sensitive."""
    boundary_margin_mm: Annotated[float, Field(ge=5, le=200)] = 20.0
    """How far outside limits.box the control box itself stops the arm."""
    ready_joints_deg: Six = (0, 36.81, 86.74, 0, 49.93, 0)
    """The ready pose. Default: TCP at (350, 0, 180) mm, gripper down."""
    ready_speed_deg_s: Annotated[float, Field(gt=0, le=30)] = 10.0
    """Joint speed of `home`, the motion to the ready pose."""
    guard: GuardConfig = GuardConfig()

    @field_validator("host")
    @classmethod
    def _somewhere(cls, host: str) -> str:
        if not host or host != "".join(host.split()):
            raise ValueError("must be the control box's address, it is on the box's label")
        return host

    @model_validator(mode="after")
    def _possible(self) -> Self:
        length_mm = math.hypot(*self.tcp_offset_mm_deg[:3])
        if length_mm > MAX_TOOL_LENGTH_MM:
            raise ValueError(
                f"tcp_offset_mm_deg puts the fingertips {length_mm:.0f} mm from the flange; "
                f"at most {MAX_TOOL_LENGTH_MM:g} mm are allowed"
            )
        if max(map(abs, self.tcp_offset_mm_deg[3:])) > 180:
            raise ValueError("tcp_offset_mm_deg: its angles must be within -180 and 180 degrees")
        if math.hypot(*self.tcp_load_centre_mm) > MAX_TOOL_LENGTH_MM:
            raise ValueError(
                f"tcp_load_centre_mm must be within {MAX_TOOL_LENGTH_MM:g} mm of the flange"
            )
        return self


class HandConfig(Section):
    """From the controller's poses to velocities."""

    rotation: tuple[Triple, Triple, Triple] = ((0, 0, -1), (-1, 0, 0), (0, 1, 0))
    """From the tracking frame (x right, y up, z backwards) to the arm's base frame: three rows."""
    translation_scale: Annotated[float, Field(gt=0, le=5)] = 1.0
    """Travel of the TCP for each metre of the hand."""
    rotation_scale: Annotated[float, Field(gt=0, le=5)] = 1.0
    """Turn of the TCP for each radian of the hand."""

    @model_validator(mode="after")
    def _proper_rotation(self) -> Self:
        check_rotation("rotation", self.rotation)
        return self


class ProfileConfig(Section):
    """Acceleration and jerk of one motion profile, linear and angular."""

    acceleration_m_s2: Positive
    """Linear acceleration at most."""
    jerk_m_s3: Positive
    """Linear jerk at most."""
    acceleration_rad_s2: Positive
    """Angular acceleration at most."""
    jerk_rad_s3: Positive
    """Angular jerk at most."""


class MotionProfileConfig(ProfileConfig):
    """While engaged."""

    acceleration_m_s2: Positive = 1.5
    jerk_m_s3: Positive = 20.0
    acceleration_rad_s2: Positive = 4.0
    jerk_rad_s3: Positive = 60.0


class StopProfileConfig(ProfileConfig):
    """After a release: from any motion to rest within 100 ms (`longest_stop_s`)."""

    acceleration_m_s2: Positive = 5.0
    jerk_m_s3: Positive = 130.0  # 100 would do from 250 mm/s, but not while the arm speeds up
    acceleration_rad_s2: Positive = 12.0
    jerk_rad_s3: Positive = 280.0


WORKSPACE = {"box_min_mm", "box_max_mm", "radius_min_mm", "radius_max_mm", "floor_mm"}
"""Keys of `LimitsConfig` that bound where the TCP may be."""


class LimitsConfig(Section):
    """Speed, acceleration, jerk and space the arm never leaves."""

    max_speed_mm_s: Positive = 250.0
    """Speed of the TCP at most, by norm. The stop profile must end it within 100 ms."""
    max_rotation_rad_s: Positive = 0.5
    """Angular speed of the TCP at most; must end within 100 ms, too."""
    motion: MotionProfileConfig = MotionProfileConfig()
    stop: StopProfileConfig = StopProfileConfig()
    box_min_mm: Triple = (150, -330, 5)
    """Lower corner of the space that the TCP never leaves, in the arm's base frame: x, y, z."""
    box_max_mm: Triple = (420, 330, 400)
    """Upper corner of that space."""
    radius_min_mm: NonNegative = 180.0
    """Distance of the TCP from the base axis at least."""
    radius_max_mm: Positive = 425.0
    """Distance of the TCP from the base axis at most."""
    floor_mm: Finite = 5.0
    """Height of the TCP at least, also during the motion to the ready pose."""
    slow_down_mm: Positive = 30.0
    """Before a limit of space, the outward speed shrinks to zero over this distance."""
    cone_deg: Annotated[float, Field(gt=0, le=90)] = 35.0
    """Tilt of the tool from the ready orientation at most."""
    leash_mm: Annotated[float, Field(gt=0, le=50)] = 15.0
    """Following error at which the target waits for the arm."""
    leash_fault_mm: Annotated[float, Field(gt=0, le=100)] = 60.0
    """Following error at which it is a fault; above leash_mm."""
    leash_rad: Annotated[float, Field(gt=0, le=0.5)] = 0.05
    """Following error in rotation at which the target waits."""
    leash_fault_rad: Annotated[float, Field(gt=0, le=1)] = 0.2
    """Following error in rotation at which it is a fault; above leash_rad."""

    @model_validator(mode="after")
    def _sane(self) -> Self:
        if any(low >= high for low, high in zip(self.box_min_mm, self.box_max_mm, strict=True)):
            raise ValueError("box_min_mm must be below box_max_mm on every axis")
        if self.floor_mm >= self.box_max_mm[2]:
            raise ValueError("floor_mm must be below the top of the box, box_max_mm")
        self.require_order(
            ("leash_mm", "leash_fault_mm"),
            ("leash_rad", "leash_fault_rad"),
            ("radius_min_mm", "radius_max_mm"),
        )
        for key in ProfileConfig.model_fields:
            if getattr(self.stop, key) < getattr(self.motion, key):
                raise ValueError(f"stop.{key} must not be below motion.{key}")
        return self

    @model_validator(mode="after")
    def _stops_in_time(self) -> Self:
        motion, stop = self.motion, self.stop
        linear = longest_stop_s(
            self.max_speed_mm_s / 1000,
            motion.acceleration_m_s2,
            stop.acceleration_m_s2,
            stop.jerk_m_s3,
        )
        angular = longest_stop_s(
            self.max_rotation_rad_s,
            motion.acceleration_rad_s2,
            stop.acceleration_rad_s2,
            stop.jerk_rad_s3,
        )
        for name, needed in (("max_speed_mm_s", linear), ("max_rotation_rad_s", angular)):
            if needed > MAX_STOP_TIME_S + 1e-9:
                raise ValueError(
                    f"{name} needs {needed * 1000:.0f} ms to stop with the stop profile, from the "
                    f"motion profile's acceleration; at most {MAX_STOP_TIME_S * 1000:.0f} ms are "
                    "allowed"
                )
        return self


ControlAgeMs = Annotated[float, Field(gt=0, le=2000)]
VideoAgeMs = Annotated[float, Field(gt=0, le=5000)]


class FreshnessConfig(Section):
    """Ages of the inputs at which the arm holds or faults.

    The times of docs/SAFETY.md are those of the defaults; the maxima keep the arm from being
    steered by what is long past.
    """

    hold_pose_ms: Annotated[float, Field(gt=0, le=200)] = 25.0
    """An unchanged pose keeps its velocity for this long; below pose_frozen_ms."""
    pose_frozen_ms: ControlAgeMs = 100.0
    """An unchanged pose is a fault from this age on."""
    buttons_ms: ControlAgeMs = 100.0
    """The last successful read of the buttons is too old from this age on."""
    arm_state_ms: ControlAgeMs = 100.0
    """The arm's report is too old from this age on."""
    arm_reply_ms: ControlAgeMs = 100.0
    """The arm's last reply to a command is too old from this age on."""
    video_slow_ms: VideoAgeMs = 500.0
    """The arm slows down from this age of the primary view's frame on."""
    video_hold_ms: VideoAgeMs = 1000.0
    """The arm holds from this age on; above video_slow_ms."""

    @model_validator(mode="after")
    def _order(self) -> Self:
        self.require_order(("video_slow_ms", "video_hold_ms"), ("hold_pose_ms", "pose_frozen_ms"))
        return self


class ControlConfig(Section):
    """The control loop."""

    rate_hz: Annotated[float, Field(ge=30, le=250)] = 120.0
    """Ticks of the control loop."""
    realtime_priority: Annotated[int, Field(ge=0, le=98)] = 50
    """SCHED_FIFO priority of the control loop; 0 asks for none."""
