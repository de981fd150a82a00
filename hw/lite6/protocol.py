"""UFACTORY's control protocol (UXBUS over TCP): its numbers, its frames, and a client for a stop.

The numbers are those of the SDK's `xarm/core/config/x_config.py`, `x_code.py` and `xarm/x3/code.py`
(FINDINGS 8), for the driver and for the model of the controller.

Request `u16 transaction, u16 protocol, u16 length, u8 register, payload`; reply the same with a
status byte before its data. Big-endian; the length counts the register and what follows (SDK
core/wrapper/uxbus_cmd_tcp.py). The stop and the guard speak it themselves: a stop must not wait for
the lock of a library whose connection hangs, and the guard must start in milliseconds.
"""

from __future__ import annotations

import socket
import struct
import time
from collections.abc import Iterator
from dataclasses import dataclass
from enum import IntEnum

from tams_app.errors import DeviceError

AXES, LITE6_TYPE = 6, 9  # as the version register and the reports give them


class Register(IntEnum):
    """Command registers of the control connection."""

    GET_VERSION = 1
    MOTION_ENABLE = 11
    SET_STATE = 12
    GET_STATE = 13
    GET_ERROR = 15
    CLEAN_ERROR = 16
    CLEAN_WARNING = 17
    SET_MODE = 19
    MOVE_JOINT = 23
    SET_TCP_OFFSET = 35
    SET_LOAD = 36
    SET_COLLISION_SENSITIVITY = 37
    GET_TCP_POSE = 41
    SET_BOUNDARY = 52
    SET_FENCE = 59
    SET_SELF_COLLISION_CHECK = 77
    SET_CARTESIAN_VELOCITY = 82
    TOOL_GPIO_WRITE = 127
    TOOL_GPIO_READ = 128


class ReplyBit(IntEnum):
    """Bits of the status byte in every reply (`check_private_protocol` of the SDK)."""

    INVALID = 0x08  # the request was not understood
    NOT_READY = 0x10
    WARNING = 0x20
    ERROR = 0x40


class Mode(IntEnum):
    """The modes that TAMS knows, as they are commanded and reported."""

    POSITION = 0
    SERVO = 1
    CARTESIAN_VELOCITY = 5


class StateCommand(IntEnum):
    """Commands for register 12, `set_state`: other numbers than the reports hold (`State`)."""

    READY = 0  # resumes what was paused
    PAUSE = 3
    STOP = 4


class State(IntEnum):
    """States that the controller reports; STOPPED and CHANGED need `READY` to move."""

    MOVING = 1
    STANDBY = 2
    PAUSED = 3
    STOPPED = 4
    CHANGED = 5  # a mode or a setting was changed


class ErrorCode(IntEnum):
    """Controller errors that the model raises by itself; `commands.py` has them all in words."""

    EMERGENCY_STOP = 2
    KINEMATIC = 21
    SELF_COLLISION = 22
    JOINT_LIMIT = 23
    JOINT_OVERSPEED = 24
    COLLISION = 31
    BOUNDARY = 35


# 10 plus the joint; they stay until the motors are enabled anew (UFACTORY in xarm_ros issue 114)
DRIVE_ERRORS = range(10, 18)


class Code(IntEnum):
    """Return codes of SDK calls that are distinguished here."""

    DISCONNECTED = -1
    OK = 0
    ERROR = 1  # the controller is in an error
    WARNING = 2
    TIMEOUT = 3
    NOT_SENT = 8
    NOT_READY = 9
    INVALID = 10


# Return codes that mean: nothing gets through. The others are answers.
NOTHING_GETS_THROUGH = frozenset({Code.DISCONNECTED, Code.NOT_SENT, Code.TIMEOUT})


def return_code_sentence(code: int, call: str) -> str:
    """One sentence for a `code` other than 0 that the SDK returned for `call`."""
    if code in (Code.DISCONNECTED, Code.NOT_SENT):
        return f"The connection to the arm is lost ({call}); check power and cable, then confirm."
    if code == Code.TIMEOUT:
        return f"The arm does not answer ({call}); check the network between here and the arm."
    if code == Code.NOT_READY:
        return f"The arm is stopped and refuses to move ({call}); arm it again."
    if code == Code.ERROR:
        return f"The arm is in an error ({call}); clear it and arm again."
    return f"The arm refused {call} with code {code}; restart its control box if this goes on."


# --- frames -------------------------------------------------------------------------------------

CONNECT_TIMEOUT_S = 1.0
_HEADER = struct.Struct(">HHH")
_HEARTBEAT_PROTOCOL = 1
_PROTOCOL = 2  # the private protocol; 0 would be Modbus TCP
_PROTOCOLS = (_HEARTBEAT_PROTOCOL, _PROTOCOL, 3)  # 3: as 2, from clients that keep the line alive
_MAX_LENGTH = 1024
_RECEIVE_BYTES = 4096


class MalformedFrameError(ConnectionError):
    """The peer uses another protocol."""


@dataclass(frozen=True, slots=True)
class UxbusFrame:
    """One request or reply; the payload of a reply begins with its status byte."""

    transaction: int
    protocol: int
    register: int
    payload: bytes

    @property
    def is_heartbeat(self) -> bool:
        """True if it only keeps the line alive and wants no answer."""
        return self.protocol == _HEARTBEAT_PROTOCOL

    def encode(self) -> bytes:
        header = _HEADER.pack(self.transaction, self.protocol, len(self.payload) + 1)
        return header + bytes([self.register]) + self.payload

    def reply(self, status_and_data: bytes) -> bytes:
        """The bytes that answer this request."""
        return UxbusFrame(self.transaction, self.protocol, self.register, status_and_data).encode()


class UxbusReader:
    """Cuts a byte stream into frames."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, received: bytes) -> Iterator[UxbusFrame]:
        """The frames that `received` completes; MalformedFrameError ends the stream."""
        self._buffer += received
        while len(self._buffer) >= _HEADER.size:
            transaction, protocol, length = _HEADER.unpack_from(self._buffer)
            if protocol not in _PROTOCOLS or not 1 <= length <= _MAX_LENGTH:
                raise MalformedFrameError(f"protocol {protocol}, length {length}")
            end = _HEADER.size + length
            if len(self._buffer) < end:
                return
            body = bytes(self._buffer[_HEADER.size : end])
            del self._buffer[:end]
            yield UxbusFrame(transaction, protocol, body[0], body[1:])


class UxbusClient:
    """One control connection. For one thread at a time."""

    def __init__(self, host: str, port: int) -> None:
        self._address: tuple[str, int] = (host, port)
        self._socket: socket.socket | None = None
        self._frames = UxbusReader()
        self._transaction = 0

    @property
    def connected(self) -> bool:
        return self._socket is not None

    def connect(self, timeout_s: float = CONNECT_TIMEOUT_S) -> None:
        """Connect anew, closing an older connection; DeviceError if nothing answers."""
        self.close()
        host, port = self._address
        try:
            self._socket = socket.create_connection(self._address, timeout_s)
            self._socket.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            if self._socket.family == socket.AF_INET:  # whose address is whole without a scope
                # looked up once: no stop waits for a name server that hangs
                self._address = self._socket.getpeername()
        except OSError as error:
            self.close()
            raise DeviceError(
                f"No arm answers at {host}:{port} ({error.strerror or error}); "
                "check its power, the network cable and arm.host in the configuration."
            ) from error

    def request(self, register: int, payload: bytes, timeout_s: float) -> tuple[int, bytes]:
        """Send one request; the status bits and the data of its reply.

        Late replies to earlier requests are skipped.

        TimeoutError if none comes within `timeout_s` (the connection stays usable),
        ConnectionError if the connection is gone.
        """
        if self._socket is None:
            raise ConnectionError("not connected")
        self._transaction = self._transaction % 0xFFFF + 1
        deadline = time.monotonic() + timeout_s
        try:
            self._socket.settimeout(timeout_s)
            request = UxbusFrame(self._transaction, _PROTOCOL, register, payload)
            self._socket.sendall(request.encode())
            while True:
                reply = self._next_reply(self._socket, deadline)
                if (reply.transaction, reply.register) == (request.transaction, register):
                    return reply.payload[0], reply.payload[1:]
        except TimeoutError:
            raise
        except OSError as error:
            self.close()
            raise ConnectionError(str(error)) from error

    def close(self) -> None:
        """Disconnect; may be called twice."""
        self._frames = UxbusReader()
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _next_reply(self, connection: socket.socket, deadline: float) -> UxbusFrame:
        """The next whole frame; one that waits already comes first."""
        data = b""
        while True:
            for frame in self._frames.feed(data):
                if not frame.payload:
                    raise MalformedFrameError("a reply without a status")
                return frame
            remaining = deadline - time.monotonic()
            if remaining <= 0:
                raise TimeoutError("no reply")
            connection.settimeout(remaining)
            data = connection.recv(_RECEIVE_BYTES)
            if not data:
                raise ConnectionResetError("the arm closed the connection")
