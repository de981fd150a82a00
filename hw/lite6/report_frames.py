"""The Lite 6's report stream cut into frames, and the motion in one; light, without numpy.

Frames as in the SDK's `x3/report.py`; the driver (`report.py`) and the guard process
(`report_watch.py`) read them on sockets of their own.
"""

from __future__ import annotations

import math
import socket
import struct

from tams_app.errors import DeviceError

REAL_PORT_OFFSET = 2  # of the real-time stream, 100 Hz
REAL_BYTES = 87  # of its frame in older firmware; newer appends the force sensor
MAX_BYTES = 4096
_CONNECT_TIMEOUT_S = 1.0

_LENGTH = struct.Struct(">I")
_MOTION = struct.Struct("<B2x6f4x6f")  # at 4: mode and state, joints [rad], pose [mm, rad]
_MOTION_AT = 4


def connect_reports(host: str, port: int) -> socket.socket:
    """A connection to a report port; DeviceError if there is none."""
    try:
        return socket.create_connection((host, port), _CONNECT_TIMEOUT_S)
    except OSError as error:
        raise silent_reports(host, port, error) from error


def silent_reports(host: str, port: int, error: OSError) -> DeviceError:
    return DeviceError(
        f"The arm at {host} sends no reports on port {port} ({error.strerror or error}); "
        "restart its control box."
    )


class FrameBuffer:
    """Cuts a byte stream into report frames; ConnectionError if these are no reports."""

    def __init__(self, min_bytes: int) -> None:
        self._min_bytes = min_bytes
        self._received = bytearray()

    def feed(self, data: bytes) -> list[bytes]:
        """The frames that are complete with `data`, oldest first, each with its length field."""
        self._received += data
        frames = []
        while len(self._received) >= _LENGTH.size:
            (length,) = _LENGTH.unpack_from(self._received)
            if not self._min_bytes <= length <= MAX_BYTES:
                raise ConnectionError(f"a report frame of {length} bytes")
            if len(self._received) < length:
                break
            frames.append(bytes(self._received[:length]))
            del self._received[:length]
        return frames


def motion_numbers(frame: bytes) -> tuple[int, list[float]] | None:
    """Mode and state in one byte; joints [rad] and pose [mm, rad]. None if one is not finite."""
    mode_and_state, *numbers = _MOTION.unpack_from(frame, _MOTION_AT)
    return (mode_and_state, numbers) if all(map(math.isfinite, numbers)) else None
