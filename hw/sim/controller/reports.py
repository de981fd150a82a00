"""The controller's report frames, byte for byte as `xarm/x3/report.py` of the SDK lays them out.

Every frame begins with its own length (big-endian u32). Numbers of more than one byte are
little-endian floats but for counters and voltages, which are big-endian.
"""

from __future__ import annotations

import math
import struct
from enum import Enum

from hw.lite6.codes import AXES, LITE6_TYPE
from hw.lite6.kinematics import JOINT_LOWER, JOINT_UPPER, Matrix, rotation_vector, rpy_from_matrix
from hw.sim.controller.core import ControllerCore, ControllerSettings
from hw.sim.controller.joint_servo import MAX_JOINT_ACCELERATION

_WHOLE_BRAKES = 0xFF
_TEACH_SENSITIVITY = 3
_JOINT_CENTIVOLTS = 4800
_NO_TORQUES = bytes(7 * 4)  # nothing in the model estimates them


class ReportKind(Enum):
    """The three report ports: offset from the port of the normal report, and rate [Hz]."""

    NORMAL = (0, 5)
    RICH = (1, 5)
    REAL = (2, 100)

    @property
    def port_offset(self) -> int:
        return self.value[0]

    @property
    def rate_hz(self) -> int:
        return self.value[1]


def pack_report(kind: ReportKind, box: ControllerCore) -> bytes:
    """The frame of `kind`: 145 bytes normal, 587 rich, 87 real."""
    body = _motion(box)
    if kind is not ReportKind.REAL:
        body += _status(box)
    if kind is ReportKind.RICH:
        body += _identity_and_limits(box) + _sensors(box) + _safety(box)
    return struct.pack(">I", len(body) + 4) + body


def pack_pose(tcp: Matrix) -> bytes:
    """x, y, z [mm], roll, pitch, yaw [rad]."""
    return struct.pack("<6f", *(tcp[:3, 3] * 1000.0).tolist(), *rpy_from_matrix(tcp[:3, :3]))


def pack_pose_aa(tcp: Matrix) -> bytes:
    """x, y, z [mm], axis times angle [rad]."""
    return struct.pack("<6f", *(tcp[:3, 3] * 1000.0).tolist(), *rotation_vector(tcp[:3, :3]))


def _motion(box: ControllerCore) -> bytes:
    return (
        struct.pack(">BH", box.mode << 4 | box.state, box.commands_waiting)
        + struct.pack("<7f", *box.joints, 0.0)
        + pack_pose(box.tcp)
        + _NO_TORQUES
    )


def _status(box: ControllerCore) -> bytes:
    settings = box.settings
    enabled = 0xFF if box.enabled else 0
    released = _WHOLE_BRAKES if box.enabled else 0
    return (
        bytes([released, enabled, box.error_code, box.warning_code])
        + struct.pack("<6f", *settings.tcp_offset)
        + struct.pack("<4f", *settings.load)
        + bytes([settings.collision_sensitivity, _TEACH_SENSITIVITY])
        + struct.pack("<3f", *settings.gravity)
    )


def _identity_and_limits(box: ControllerCore) -> bytes:
    tcp_limits = (1000.0, 1.0, 50_000.0, 0.1, 500.0)  # jerk, acceleration and speed [mm]
    joint_limits = (20.0, 0.01, MAX_JOINT_ACCELERATION, 0.0001, math.pi)  # the same [rad]
    rotation_limits = (2.3, 2.7)  # jerk and acceleration of pure rotations [rad]
    return (
        bytes([LITE6_TYPE, AXES, 0, 0, 0, 0])
        + version_text(box.firmware).encode("ascii")[:29].ljust(30, b"\0")
        + struct.pack("<12f", *tcp_limits, *joint_limits, *rotation_limits)
    )


def _sensors(box: ControllerCore) -> bytes:
    settings = box.settings
    drive_codes = bytes(byte for code in box.drive_codes for byte in (bool(code), code))
    seventh_drive_and_tool_codes, counter = bytes(4), bytes(4)
    collision_tool = bytes(1 + 24)
    currents = bytes(28)
    control_box_io = bytes(2 + 16 + 32)
    force_sensor = bytes(48)
    return (
        drive_codes
        + seventh_drive_and_tool_codes
        + struct.pack("7b", *box.temperatures_c, 0)
        + struct.pack("<8f", box.tcp_speed_mm_s, *box.joint_speeds, 0.0)
        + counter
        + struct.pack("<6f", *settings.world_offset)
        + bytes([0, settings.clear_outputs_on_stop])  # of control box and tool
        + bytes([settings.simulation_robot, settings.self_collision_check])
        + collision_tool
        + struct.pack(">7H", *[_JOINT_CENTIVOLTS] * 7)
        + currents
        + control_box_io
        + force_sensor
    )


def _safety(box: ControllerCore) -> bytes:
    settings = box.settings
    identification_progress, monitored_device = bytes(1), bytes(13)
    switches = settings.fence << 1 | settings.approximate_motion << 3  # of several
    return (
        identification_progress
        + struct.pack("<3f", *rotation_vector(box.tcp[:3, :3]))
        + bytes([switches])
        + pack_reduced_mode(settings)
        + monitored_device
    )


def pack_reduced_mode(settings: ControllerSettings) -> bytes:
    """The 79 bytes of register 53: boundary, speeds of the reduced mode, joint ranges, switches."""
    boundary = settings.boundary
    edges = [
        max(-0x8000, min(0x7FFF, edge))
        for pair in zip(boundary.upper_mm, boundary.lower_mm, strict=True)
        for edge in pair
    ]
    ranges = [angle for pair in zip(JOINT_LOWER, JOINT_UPPER, strict=True) for angle in pair]
    return (
        bytes([settings.reduced is not None])
        + struct.pack(">6h", *edges)
        + struct.pack("<2f", *settings.reduced or (500.0, math.pi))
        + struct.pack("<14f", *ranges, 0.0, 0.0)
        + bytes([settings.fence, settings.collision_rebound])
    )


def version_text(firmware: str) -> str:
    """The version register: axes, type, serial numbers, firmware; at most 39 characters.

    The SDK looks for the terminating zero within 40 bytes.
    """
    return f"{AXES},{LITE6_TYPE},LI1006210001,DL1006210001,v{firmware}"[:39]
