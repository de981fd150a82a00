"""The Lite 6 controller box as a pure model: a request in, a reply out, one cycle at a time.

It holds no thread, socket or clock. `ControllerServer` puts it on TCP, `InProcessArm` drives it
in virtual time. Headers, integers and GPIO values of the registers are big-endian, floats and int32
lists little-endian (FINDINGS 8; uxbus_cmd.py of the SDK). Replies shorter than the SDK asks for
would be misread by it.

Report frames are byte for byte as `xarm/x3/report.py` of the SDK lays them out: each begins with
its own length (big-endian u32), numbers of more than one byte are little-endian floats but for
counters and voltages, which are big-endian.
"""

from __future__ import annotations

import math
import struct
from enum import Enum

from hw.arm import PlantState, TcpBoundary
from hw.lite6.kinematics import JOINT_LOWER, JOINT_UPPER, Matrix, rotation_vector, rpy_from_matrix
from hw.lite6.protocol import AXES, LITE6_TYPE, Register, ReplyBit
from hw.sim.controller.core import ControllerCore, ControllerSettings
from hw.sim.controller.joint_servo import (
    CYCLE_NS,
    MAX_JOINT_ACCELERATION,
    CommandError,
    MotionError,
)
from tams_app.vectors import Joints

__all__ = ["CYCLE_NS", "ControllerModel", "IdealPlant", "ReportKind"]

ALL_JOINTS = 8
TOOL_DIGITAL_OUT, TOOL_OUTPUT_STATE = 0x0A15, 0x0A18
_TOOL_OUTPUTS = 0x1F  # five of them; the high byte of a write says which ones it sets

_WHOLE_BRAKES = 0xFF
_TEACH_SENSITIVITY = 3
_JOINT_CENTIVOLTS = 4800
_NO_TORQUES = bytes(7 * 4)  # nothing in the model estimates them


class ReportKind(Enum):
    """The report ports that the driver reads: offset from the first of the box, and rate [Hz]."""

    RICH = (1, 5)
    REAL = (2, 100)

    @property
    def port_offset(self) -> int:
        return self.value[0]

    @property
    def rate_hz(self) -> int:
        return self.value[1]


class IdealPlant:
    """Joints that are where they should be, at once."""

    def step(self, joints_target: Joints, closing: bool | None, duration_ns: int) -> PlantState:
        return PlantState(joints_target, collision=False)


class ControllerModel(ControllerCore):
    """The box with its registers and reports; not safe for threads: its server holds a lock."""

    def handle(self, register: int, payload: bytes, now_ns: int) -> bytes:
        """Serve one request; the reply's status byte and data.

        A register the model does not have, or a payload it cannot read, changes nothing and sets
        the status bit INVALID.
        """
        self._now_ns = now_ns
        before = self._status()
        try:
            data = self._serve(register, payload)
        except CommandError:
            return bytes([before | ReplyBit.INVALID])
        except MotionError as fault:
            self.raise_error(fault.code)
            data = b""
        # a load is taken while ready and only then waits for `set_state(0)`: its reply says ready
        status = before if register == Register.SET_LOAD else self._status()
        return bytes([status]) + data

    def report(self, kind: ReportKind) -> bytes:
        """A whole report frame of `kind`: 587 bytes rich, 87 real."""
        body = _pack_motion(self)
        if kind is ReportKind.RICH:
            body += _pack_status(self) + _pack_identity_and_limits(self)
            body += _pack_sensors(self) + _pack_safety(self)
        return struct.pack(">I", len(body) + 4) + body

    def _status(self) -> int:
        return (
            (0 if self.ready else ReplyBit.NOT_READY)
            | (ReplyBit.WARNING if self.warning_code else 0)
            | (ReplyBit.ERROR if self.error_code else 0)
        )

    def _serve(self, register: int, payload: bytes) -> bytes:
        """The data of the reply; CommandError if there is no such register or it makes no sense."""
        try:
            answer = self._query(register, payload)
            if answer is None:
                self._command(register, payload)
        except struct.error as error:
            raise CommandError(f"register {register} needs a longer payload") from error
        return answer or b""

    def _query(self, register: int, payload: bytes) -> bytes | None:
        """What it is and how it is; None if that is not what `register` asks for."""
        match register:
            case Register.GET_VERSION:
                return version_text(self.firmware).encode("ascii").ljust(40, b"\0")
            case Register.GET_STATE:
                return bytes([self.state])
            case Register.GET_ERROR:
                return bytes([self.error_code, self.warning_code])
            case Register.GET_TCP_POSE:
                return _pack_pose(self.tcp)
            case Register.TOOL_GPIO_READ:
                address = struct.unpack_from(">H", payload, 1)[0]
                if address != TOOL_OUTPUT_STATE:
                    raise CommandError(f"tool address {address:#06x} cannot be read")
                return struct.pack(">i", self.settings.tool_outputs)  # as commanded: not sensed
        return None

    def _command(self, register: int, payload: bytes) -> None:
        """Change state, mode or a setting, or move."""
        settings = self.settings
        match register:
            case Register.SET_CARTESIAN_VELOCITY:
                self._move_tcp(payload)
            case Register.MOVE_JOINT:
                self._move_joint(payload)
            case Register.MOTION_ENABLE:
                joint, on = _byte(payload), _byte(payload, 1)
                if joint != ALL_JOINTS:
                    raise CommandError("single joints cannot be enabled")
                self.enable(bool(on))
            case Register.SET_STATE:
                self.set_state(_byte(payload))
            case Register.SET_MODE:
                self.set_mode(_byte(payload))
            case Register.CLEAN_ERROR:
                self.clean_error()
            case Register.CLEAN_WARNING:
                self.raise_warning(0)
            case Register.SET_TCP_OFFSET:
                self.set_tcp_offset(_floats(payload, 6))
            case Register.SET_LOAD:
                settings.load = _floats(payload, 4)
                self.configuration_changed()
            case Register.SET_COLLISION_SENSITIVITY:
                if (sensitivity := _byte(payload)) > 5:
                    raise CommandError("collision sensitivity ends at 5")
                settings.collision_sensitivity = sensitivity
                self.configuration_changed()
            case Register.SET_BOUNDARY:
                x_high, x_low, y_high, y_low, z_high, z_low = struct.unpack_from("<6i", payload)
                settings.boundary = TcpBoundary((x_low, y_low, z_low), (x_high, y_high, z_high))
            case Register.SET_FENCE:
                settings.fence = bool(_byte(payload))
            case Register.SET_SELF_COLLISION_CHECK:
                settings.self_collision_check = bool(_byte(payload))
            case Register.TOOL_GPIO_WRITE:
                self._set_tool_outputs(payload)
            case _:
                raise CommandError(f"register {register} is not modelled")

    def _move_tcp(self, payload: bytes) -> None:
        twist = _floats(payload, 6)
        if _byte(payload, 24):
            raise CommandError("velocities in the tool frame are not modelled")
        (duration_s,) = _floats(payload[25:], 1)  # not from firmware before 1.8, which is refused
        linear = tuple(speed / 1000.0 for speed in twist[:3])
        self.servo_twist((*linear, *twist[3:]), duration_s)

    def _move_joint(self, payload: bytes) -> None:
        values = _floats(payload, 10)
        speed, acceleration = values[7:9]
        if not (speed > 0 and acceleration > 0):
            raise CommandError("speed and acceleration must be positive")
        self.move_joints(values[:6], speed, acceleration)

    def _set_tool_outputs(self, payload: bytes) -> None:
        address = struct.unpack_from(">H", payload, 1)[0]
        if address != TOOL_DIGITAL_OUT:
            raise CommandError(f"tool address {address:#06x} cannot be written")
        value = int(_floats(payload[3:], 1)[0])
        changed = value >> 8 & _TOOL_OUTPUTS
        outputs = self.settings.tool_outputs
        self.settings.tool_outputs = (outputs & ~changed) | (value & changed)


def _byte(payload: bytes, offset: int = 0) -> int:
    value: int = struct.unpack_from("B", payload, offset)[0]
    return value


def _floats(payload: bytes, count: int) -> tuple[float, ...]:
    """`count` floats; CommandError if one is not finite."""
    values = struct.unpack_from(f"<{count}f", payload)
    if not all(map(math.isfinite, values)):
        raise CommandError("a value is not a number")
    return values


def _pack_pose(tcp: Matrix) -> bytes:
    """x, y, z [mm], roll, pitch, yaw [rad]."""
    return struct.pack("<6f", *(tcp[:3, 3] * 1000.0).tolist(), *rpy_from_matrix(tcp[:3, :3]))


def _pack_motion(box: ControllerCore) -> bytes:
    return (
        struct.pack(">BH", box.mode << 4 | box.state, box.commands_waiting)
        + struct.pack("<7f", *box.joints, 0.0)
        + _pack_pose(box.tcp)
        + _NO_TORQUES
    )


def _pack_status(box: ControllerCore) -> bytes:
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


def _pack_identity_and_limits(box: ControllerCore) -> bytes:
    tcp_limits = (1000.0, 1.0, 50_000.0, 0.1, 500.0)  # jerk, acceleration and speed [mm]
    joint_limits = (20.0, 0.01, MAX_JOINT_ACCELERATION, 0.0001, math.pi)  # the same [rad]
    rotation_limits = (2.3, 2.7)  # jerk and acceleration of pure rotations [rad]
    return (
        bytes([LITE6_TYPE, AXES, 0, 0, 0, 0])
        + version_text(box.firmware).encode("ascii")[:29].ljust(30, b"\0")
        + struct.pack("<12f", *tcp_limits, *joint_limits, *rotation_limits)
    )


def _pack_sensors(box: ControllerCore) -> bytes:
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


def _pack_safety(box: ControllerCore) -> bytes:
    settings = box.settings
    identification_progress, monitored_device = bytes(1), bytes(13)
    switches = settings.fence << 1 | settings.approximate_motion << 3  # of several
    return (
        identification_progress
        + struct.pack("<3f", *rotation_vector(box.tcp[:3, :3]))
        + bytes([switches])
        + _pack_reduced_mode(settings)
        + monitored_device
    )


def _pack_reduced_mode(settings: ControllerSettings) -> bytes:
    """79 bytes: boundary, speeds of the reduced mode, joint ranges, switches."""
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
