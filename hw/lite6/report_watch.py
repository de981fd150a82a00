"""The Lite 6's report streams cut into frames, and the guard's watch of the real-time one.

Light, without numpy: the guard process starts with it. Frames as in the SDK's `x3/report.py`; the
driver (`report.py`) reads them on sockets of its own.
"""

from __future__ import annotations

import math
import socket
import struct

from hw.arm_report import ArmReport
from tams_app.errors import DeviceError
from tams_app.units import NS_PER_MS

REAL_PORT_OFFSET = 2  # of the real-time stream, 100 Hz
REAL_BYTES = 87  # of its frame in older firmware; newer appends the force sensor
MAX_BYTES = 4096
_CONNECT_TIMEOUT_S = 1.0
_SILENT_NS = 500 * NS_PER_MS  # 50 reports: the connection is dead, or was never made

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


class Lite6ReportWatch:
    """Reads received reports, and connects anew after half a second of silence; no call waits."""

    def __init__(self, host: str, report_port: int) -> None:
        self._address: tuple[str, int] = (host, report_port + REAL_PORT_OFFSET)
        self._family = socket.AF_INET
        self._socket: socket.socket | None = None
        self._frames = FrameBuffer(REAL_BYTES)
        self._received_ns: int | None = None  # or connected

    def start(self) -> None:
        """Connect; DeviceError if there is nothing to connect to."""
        self._socket = connect_reports(*self._address)
        self._socket.setblocking(False)
        # looked up once: a name server that hangs must not hold the guard up
        self._family, self._address = self._socket.family, self._socket.getpeername()

    def newest(self, now_ns: int) -> ArmReport | None:
        """The newest report that has come since the last call."""
        if self._received_ns is None:
            self._received_ns = now_ns
        report = self._read()
        if report is not None:
            self._received_ns = now_ns
        elif now_ns - self._received_ns > _SILENT_NS:
            self._received_ns = now_ns
            self._connect_anew()
        return report

    def close(self) -> None:
        """Disconnect; may be called twice."""
        if self._socket is not None:
            self._socket.close()
            self._socket = None

    def _read(self) -> ArmReport | None:
        report = None
        try:
            while self._socket is not None:
                data = self._socket.recv(MAX_BYTES)
                if not data:
                    self.close()
                for frame in self._frames.feed(data):
                    report = _report(frame) or report
        except BlockingIOError:
            pass  # that was all, or it is not connected yet
        except OSError:
            self.close()  # made anew, and until then the guard is blind, which it reports
        return report

    def _connect_anew(self) -> None:
        self.close()
        self._frames = FrameBuffer(REAL_BYTES)
        try:
            self._socket = socket.socket(self._family, socket.SOCK_STREAM)
            self._socket.setblocking(False)
            self._socket.connect_ex(self._address)  # what becomes of it shows in reading
        except OSError:
            self.close()


def _report(frame: bytes) -> ArmReport | None:
    motion = motion_numbers(frame)
    if motion is None:
        return None
    _, numbers = motion
    x, y, z = (value / 1000.0 for value in numbers[6:9])
    return ArmReport((x, y, z), tuple(numbers[:6]))
