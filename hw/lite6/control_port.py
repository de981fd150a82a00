"""The connection that UFACTORY's SDK sends its commands on, in place of the SDK's own.

The SDK's reads replies in a thread and hands them over in a queue, so that each command waits for
two wakes. Here the thread that waits for a reply reads it. The methods are named, and report
errors, as the SDK expects it of a port.
"""

from __future__ import annotations

import contextlib
import logging
import select
import socket
import struct
import time
from queue import Queue

CONNECT_TIMEOUT_S = 1.0
_LENGTH = struct.Struct(">4xH")  # of what follows this header
_LEAST_BYTES = _LENGTH.size + 2  # register and status
_REGISTER_AT = 6
_FEEDBACK_REGISTER = 0xFF  # unasked; the SDK's feedback thread takes it
_RECEIVE_BYTES = 4096
_FAILED = -1

_log = logging.getLogger(__name__)


class ControlPort:
    """One control connection; requests and their replies are one thread's at a time.

    The SDK's lock around each command sees to that. Replies that come too late are left to the
    SDK, which knows them by their transaction.
    """

    def __init__(self, host: str, port: int, feedback: Queue[bytes]) -> None:
        """Connect; OSError if nothing answers."""
        self.com = socket.create_connection((host, port), CONNECT_TIMEOUT_S)
        self.com.setblocking(False)
        self._readable = select.poll()
        self._readable.register(self.com, select.POLLIN)
        self._feedback = feedback
        self._received = bytearray()
        self.connected = True

    def write(self, data: bytes) -> int:
        """Send a request; 0, or -1 if it cannot be sent whole: the connection is given up then."""
        if not self.connected:
            return _FAILED
        try:
            sent = self.com.send(data)
        except OSError as error:
            self._lose(error)
            return _FAILED
        if sent < len(data):  # what followed would be read as the rest of it
            self._lose(ConnectionError(f"{sent} of {len(data)} bytes were sent"))
            return _FAILED
        return 0

    def read(self, timeout: float) -> bytes | int:
        """The next reply; -1 if none comes within `timeout` [s] or the connection is gone."""
        deadline = time.monotonic() + timeout
        while self.connected:
            frame = self._next_frame()
            if frame is not None:
                return frame
            left_ms = (deadline - time.monotonic()) * 1000.0
            if left_ms <= 0.0 or not self._readable.poll(left_ms):
                return _FAILED
            try:
                data = self.com.recv(_RECEIVE_BYTES)
            except BlockingIOError:
                continue
            except OSError as error:
                self._lose(error)
            else:
                self._received += data
                if not data:
                    self._lose(ConnectionResetError("the arm closed the connection"))
        return _FAILED

    def flush(self) -> int:
        """Nothing waits here but what the SDK passes over by itself."""
        return 0 if self.connected else _FAILED

    def close(self) -> None:
        """Disconnect; may be called twice, also while another thread reads."""
        self.connected = False
        with contextlib.suppress(OSError):  # it was not connected any more
            self.com.shutdown(socket.SHUT_RDWR)
        self.com.close()

    def join(self) -> None:
        """There is no thread to wait for."""

    def _next_frame(self) -> bytes | None:
        """The first whole reply of what was received."""
        received = self._received
        while len(received) >= _LENGTH.size:
            end = _LENGTH.size + _LENGTH.unpack_from(received)[0]
            if end < _LEAST_BYTES:
                self._lose(ConnectionError(f"a reply of {end} bytes"))
                return None
            if len(received) < end:
                return None
            frame = bytes(received[:end])
            del received[:end]
            if frame[_REGISTER_AT] != _FEEDBACK_REGISTER:
                return frame
            self._feedback.put(frame)
        return None

    def _lose(self, error: OSError) -> None:
        self.connected = False
        _log.debug("The arm's connection is lost: %s", error)
