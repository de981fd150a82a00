"""The few bytes of UFACTORY's control protocol (UXBUS over TCP) that a stop needs.

Request `u16 transaction, u16 protocol, u16 length, u8 register, payload`; reply the same with a
status byte before its data; the header is big-endian (SDK core/wrapper/uxbus_cmd_tcp.py).
The stop and the guard speak it themselves: a stop must not wait for the lock of a library whose
connection hangs, and the guard must start in milliseconds.
"""

from __future__ import annotations

import socket
import struct
import time
from dataclasses import dataclass

from tams_app.errors import DeviceError

CONNECT_TIMEOUT_S = 1.0
_PROTOCOL = 2  # the private protocol; 0 would be Modbus TCP
_HEADER = struct.Struct(">HHH")
_RECEIVE_BYTES = 4096


@dataclass(frozen=True, slots=True)
class Reply:
    """The controller's answer: its status bits and the data of the register."""

    status: int
    data: bytes


class UxbusClient:
    """One control connection. For one thread at a time."""

    def __init__(self, host: str, port: int) -> None:
        self._address = (host, port)
        self._socket: socket.socket | None = None
        self._received = bytearray()
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
        except OSError as error:
            self.close()
            raise DeviceError(
                f"No arm answers at {host}:{port} ({error.strerror or error}); "
                "check its power, the network cable and arm.host in the configuration."
            ) from error

    def request(self, register: int, payload: bytes, timeout_s: float) -> Reply:
        """Send one request and wait for its reply; late replies to earlier ones are skipped.

        TimeoutError if none comes within `timeout_s` (the connection stays usable),
        ConnectionError if the connection is gone.
        """
        if self._socket is None:
            raise ConnectionError("not connected")
        self._transaction = self._transaction % 0xFFFF + 1
        body = bytes([register]) + payload
        deadline = time.monotonic() + timeout_s
        try:
            self._socket.settimeout(timeout_s)
            self._socket.sendall(_HEADER.pack(self._transaction, _PROTOCOL, len(body)) + body)
            while True:
                transaction, answer = self._next_frame(self._socket, deadline)
                if transaction == self._transaction and answer[0] == register:
                    return Reply(answer[1], answer[2:])
        except TimeoutError:
            raise
        except OSError as error:
            self.close()
            raise ConnectionError(str(error)) from error

    def close(self) -> None:
        """Disconnect; may be called twice."""
        self._received.clear()
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _next_frame(self, connection: socket.socket, deadline: float) -> tuple[int, bytes]:
        """Transaction number and body (register, status, data) of the next whole frame."""
        while True:
            frame = self._take_frame()
            if frame is not None:
                return frame
            remaining = deadline - time.monotonic()
            if remaining <= 0:
                raise TimeoutError("no reply")
            connection.settimeout(remaining)
            data = connection.recv(_RECEIVE_BYTES)
            if not data:
                raise ConnectionResetError("the arm closed the connection")
            self._received += data

    def _take_frame(self) -> tuple[int, bytes] | None:
        if len(self._received) < _HEADER.size:
            return None
        transaction, _, length = _HEADER.unpack_from(self._received)
        end = _HEADER.size + length
        if length < 2:
            raise ConnectionError("the peer does not speak the arm's protocol")
        if len(self._received) < end:
            return None
        body = bytes(self._received[_HEADER.size : end])
        del self._received[:end]
        return transaction, body
