"""The Lite 6 controller box as a pure model: a request in, a reply out, one cycle at a time.

It holds no thread, socket or clock. `ControllerServer` puts it on TCP, `InProcessArm` drives it
in virtual time. Headers, integers and GPIO values of the registers are big-endian, floats and int32
lists little-endian (FINDINGS 8; uxbus_cmd.py of the SDK). Replies shorter than the SDK asks for
would be misread by it.
"""

from __future__ import annotations

import math
import struct

import numpy as np

from hw.arm import PlantState, TcpBoundary
from hw.lite6.codes import Register, ReplyBit
from hw.sim.controller.core import ControllerCore
from hw.sim.controller.joint_servo import CYCLE_NS, CommandError, MotionError
from hw.sim.controller.reports import (
    ReportKind,
    pack_pose,
    pack_pose_aa,
    pack_reduced_mode,
    pack_report,
    version_text,
)
from tams_app.vectors import Joints

__all__ = ["CYCLE_NS", "ControllerModel", "IdealPlant", "ReportKind"]

ALL_JOINTS = 8
TOOL_DIGITAL_IN, TOOL_DIGITAL_OUT, TOOL_OUTPUT_STATE = 0x0A14, 0x0A15, 0x0A18
_TOOL_OUTPUTS = 0x1F  # five of them; the high byte of a write says which ones it sets
_SERIAL_NUMBERS = b"LI1006210001\0DL1006210001\0".ljust(40, b"\0")


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
        """A whole report frame of `kind`, its length first."""
        return pack_report(kind, self)

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
            case Register.GET_ROBOT_SN:
                return _SERIAL_NUMBERS
            case Register.GET_STATE:
                return bytes([self.state])
            case Register.GET_COMMAND_COUNT:
                return struct.pack(">H", self.commands_waiting)
            case Register.GET_ERROR:
                return bytes([self.error_code, self.warning_code])
            case Register.GET_TCP_POSE:
                return pack_pose(self.tcp)
            case Register.GET_TCP_POSE_AA:
                return pack_pose_aa(self.tcp)
            case Register.GET_REDUCED_STATE:
                return pack_reduced_mode(self.settings)
            case Register.GET_JOINTS:
                # seven angles; asked with a count: angles, speeds, efforts (0) up to n of the three
                count = max(1, min(3, _byte(payload) & 0x0F)) if payload else 1
                rows = np.zeros((3, 7), dtype="<f4")
                rows[0, :6], rows[1, :6] = self.joints, self.joint_speeds
                return rows[:count].tobytes()
            case Register.TOOL_GPIO_READ:
                return self._tool_gpio(struct.unpack_from(">H", payload, 1)[0])
        return None

    def _tool_gpio(self, address: int) -> bytes:
        if address == TOOL_OUTPUT_STATE:
            return struct.pack(">i", self.settings.tool_outputs)  # the command, nothing senses it
        if address == TOOL_DIGITAL_IN:
            return struct.pack(">i", 0)
        raise CommandError(f"tool address {address:#06x} cannot be read")

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
        # firmware before 1.8 knows no duration, and the SDK does not send it one
        duration_s = _floats(payload[25:], 1)[0] if len(payload) > 25 else 0.0
        linear = tuple(speed / 1000.0 for speed in twist[:3])
        self.servo_twist((*linear, *twist[3:]), duration_s)

    def _move_joint(self, payload: bytes) -> None:
        values = _floats(payload, 10, infinite=True)
        speed, acceleration = values[7:9]
        if not (0 < speed < math.inf and 0 < acceleration < math.inf):
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


def _floats(payload: bytes, count: int, infinite: bool = False) -> tuple[float, ...]:
    """`count` floats; CommandError if one is no number, or infinite where that means nothing."""
    values = struct.unpack_from(f"<{count}f", payload)
    if any(math.isnan(value) or (math.isinf(value) and not infinite) for value in values):
        raise CommandError("a value is not a number")
    return values
