"""The Lite 6's real-time reports as the guard process reads them, on a connection of its own."""

from __future__ import annotations

import socket

from hw.arm_report import ArmReport
from hw.lite6.report_frames import (
    MAX_BYTES,
    REAL_BYTES,
    REAL_PORT_OFFSET,
    FrameBuffer,
    connect_reports,
    motion_numbers,
)
from tams_app.units import NS_PER_MS

_SILENT_NS = 500 * NS_PER_MS  # 50 reports: the connection is dead, or was never made


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
