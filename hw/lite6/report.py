"""The Lite 6's report streams, read on sockets of our own.

The real-time stream (100 Hz) has joints, TCP, mode and state; errors, motors and all settings come
only with the rich one (5 Hz). The SDK's report thread takes one stream only, gives no time of
receipt, and polls every millisecond: more processor time, and reports up to 2 ms later.
"""

from __future__ import annotations

import select
import socket
import struct
import threading
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from hw.lite6.kinematics import pose_from_mm_rpy
from hw.lite6.report_watch import (
    MAX_BYTES,
    REAL_BYTES,
    REAL_PORT_OFFSET,
    FrameBuffer,
    connect_reports,
    motion_numbers,
    silent_reports,
)
from tams_app.records import Pose, Vector
from tams_app.runtime.clock import Clock
from tams_app.runtime.worker import Worker
from tams_app.units import NS_PER_S

RICH_PORT_OFFSET = 1
POLL_MS = 100
STATUS_STALE_NS = NS_PER_S  # five periods of the rich report

# Where the SDK's `_Report30002DataStructure` (x3/report.py) has them
_STATUS_AT = REAL_BYTES  # motors, error, warning, offset, load, sensitivity, gravity
_STATUS = struct.Struct("<x3B6f4fBx3f")
_DRIVES_AT = 229  # status and error of each of seven drives, those of the tool, temperatures
_DRIVES = struct.Struct("<14B2x7b")
_SWITCHES_AT = 288  # world offset, tool outputs cleared by a stop, simulation, self-collision check
_SWITCHES = struct.Struct("<6fx3B")
_REDUCED_AT = 494  # switches of motion, reduced mode, boundary, its speeds
_REDUCED, _BOUNDARY = struct.Struct("<2B12x2f"), struct.Struct(">6h")
_FENCE_AT = 572  # the boundary's switch, collision rebound
_RICH_BYTES = _FENCE_AT + 2
_ALL_MOTORS = 0b111111


@dataclass(frozen=True, slots=True)
class StatusReport:
    """The rich report's additions, in the units of the wire (mm, rad, kg)."""

    received_ns: int
    motors_enabled: bool
    error_code: int
    warning_code: int
    tcp_offset: tuple[float, ...]  # x, y, z [mm], roll, pitch, yaw [rad]
    load: tuple[float, ...]  # [kg], centre of gravity x, y, z [mm]
    collision_sensitivity: int  # 0: it detects none
    gravity: tuple[float, ...]  # its direction in the base frame, as the mounting was set
    drive_codes: tuple[int, ...]  # errors of the six joints' own drives; 0: none
    temperatures_c: tuple[int, ...]  # of the six joints' motors
    world_offset: tuple[float, ...]  # of the base: x, y, z [mm], roll, pitch, yaw [rad]
    clears_outputs: bool  # a stop switches the tool's outputs off
    simulated: bool  # it only pretends to move
    self_collision_check: bool
    approximate: bool  # it passes singularities beside the path
    reduced: tuple[float, float] | None  # mode with speeds of its own [mm/s, rad/s]; None: off
    boundary: tuple[int, ...] | None  # edges as registers 52 and 53 order them [mm]; None: off
    rebound: bool  # it moves back by itself after a collision


@dataclass(frozen=True, slots=True)
class MotionReport:
    """The real-time report: joints [rad], shape (6,); TCP in the base frame."""

    received_ns: int
    joints: Vector
    tcp: Pose
    mode: int
    state: int


def parse_motion(frame: bytes, received_ns: int) -> MotionReport | None:
    """Joints, TCP, mode and state of any report frame; None if the numbers are not finite."""
    motion = motion_numbers(frame)
    if motion is None:
        return None
    mode_and_state, numbers = motion
    return MotionReport(
        received_ns=received_ns,
        joints=np.array(numbers[:6]),
        tcp=pose_from_mm_rpy(numbers[6:]),
        mode=mode_and_state >> 4,
        state=mode_and_state & 0x0F,
    )


def parse_status(frame: bytes, received_ns: int) -> StatusReport:
    """Errors, motors and settings of a rich report frame."""
    motors, error, warning, *rest = _STATUS.unpack_from(frame, _STATUS_AT)
    drives = _DRIVES.unpack_from(frame, _DRIVES_AT)
    *world_offset, clears, simulated, checks = _SWITCHES.unpack_from(frame, _SWITCHES_AT)
    switches, reduced, speed, joint_speed = _REDUCED.unpack_from(frame, _REDUCED_AT)
    edges = _BOUNDARY.unpack_from(frame, _REDUCED_AT + 2)
    fence, rebound = frame[_FENCE_AT : _FENCE_AT + 2]
    return StatusReport(
        received_ns=received_ns,
        motors_enabled=motors & _ALL_MOTORS == _ALL_MOTORS,
        error_code=error,
        warning_code=warning,
        tcp_offset=tuple(rest[:6]),
        load=tuple(rest[6:10]),
        collision_sensitivity=rest[10],
        gravity=tuple(rest[11:]),
        drive_codes=drives[1:12:2],
        temperatures_c=drives[14:20],
        world_offset=tuple(world_offset),
        clears_outputs=bool(clears),
        simulated=bool(simulated),
        self_collision_check=bool(checks),
        approximate=bool(switches & 0b1000),
        reduced=(speed, joint_speed) if reduced else None,
        boundary=edges if fence else None,
        rebound=bool(rebound),
    )


def read_status(host: str, report_port: int) -> StatusReport:
    """What the controller reports now, over a connection for it; DeviceError if nothing comes."""
    frames = FrameBuffer(_RICH_BYTES)
    with connect_reports(host, report_port + RICH_PORT_OFFSET) as connection:
        while True:
            try:
                data = connection.recv(MAX_BYTES)
                complete = frames.feed(data)
            except OSError as error:
                raise silent_reports(host, report_port, error) from error
            if complete:
                return parse_status(complete[0], received_ns=0)
            if not data:
                raise silent_reports(host, report_port, ConnectionResetError("connection closed"))


@dataclass(frozen=True, slots=True)
class _Stream:
    """A report connection, what came of the next frame, and who takes a whole one."""

    connection: socket.socket
    frames: FrameBuffer
    take: Callable[[bytes, int], None]


class ReportReader:
    """A thread that keeps the newest reports and when they came.

    `motion` stops at its last value when either stream falls silent: joints without the error
    code beside them are not a state to act on.
    """

    def __init__(self, host: str, report_port: int, clock: Clock) -> None:
        self._host, self._port, self._clock = host, report_port, clock
        self._news = threading.Condition()
        self.motion: MotionReport | None = None
        self.status: StatusReport | None = None
        self._sockets: list[socket.socket] = []
        self._worker = Worker("arm-report", self._run, self._on_death)
        self.failure = ""
        self.native_id: int | None = None
        # receives each status but the first, after the one before
        self.on_status: Callable[[StatusReport, StatusReport], None] = lambda *_: None
        # the same of motions, each before it is shown
        self.on_motion: Callable[[MotionReport, MotionReport], None] = lambda *_: None

    def start(self) -> None:
        """Connect to both streams; DeviceError if one is not there."""
        for offset in (RICH_PORT_OFFSET, REAL_PORT_OFFSET):
            self._sockets.append(connect_reports(self._host, self._port + offset))
        self._worker.start()

    def note_error(self, error_code: int, warning_code: int) -> None:
        """Codes learned from a reply, before the report that brings them."""
        if self.status is not None:
            self._keep(replace(self.status, error_code=error_code, warning_code=warning_code))

    def wait_for(self, condition: Callable[[], bool], timeout_s: float) -> bool:
        """Wait until `condition` holds, looking after each report; False if time is up."""
        with self._news:
            return self._news.wait_for(lambda: condition() or bool(self.failure), timeout_s) and (
                condition()
            )

    def next_status(
        self, timeout_s: float, is_wanted: Callable[[StatusReport], bool] = lambda _: True
    ) -> StatusReport | None:
        """The first status from now on that is wanted, with motion; None if none comes in time."""
        asked_ns = self._clock.now_ns()

        def has_come() -> bool:
            now = self.status
            if now is None or now.received_ns <= asked_ns or self.motion is None:
                return False
            return is_wanted(now)

        return self.status if self.wait_for(has_come, timeout_s) else None

    def close(self) -> None:
        """End the thread and disconnect; may be called twice."""
        self._worker.stop()
        while self._sockets:
            self._sockets.pop().close()

    def _run(self, stop: threading.Event) -> None:
        self.native_id = threading.get_native_id()
        rich, real = self._sockets
        streams = (
            _Stream(rich, FrameBuffer(_RICH_BYTES), self._take_status),
            _Stream(real, FrameBuffer(REAL_BYTES), self._take_motion),
        )
        waiting = select.poll()
        by_number = {stream.connection.fileno(): stream for stream in streams}
        for number in by_number:
            waiting.register(number, select.POLLIN)
        while not stop.is_set():
            for number, _ in waiting.poll(POLL_MS):
                self._read(by_number[number])

    def _read(self, stream: _Stream) -> None:
        data = stream.connection.recv(MAX_BYTES)
        received_ns = self._clock.now_ns()
        if not data:
            raise ConnectionResetError("the arm closed a report connection")
        complete = stream.frames.feed(data)
        if complete:
            stream.take(complete[-1], received_ns)  # older ones waited: the newest is the state
            with self._news:
                self._news.notify_all()

    def _take_motion(self, frame: bytes, received_ns: int) -> None:
        status = self.status
        if status is None or received_ns - status.received_ns > STATUS_STALE_NS:
            return
        before, motion = self.motion, parse_motion(frame, received_ns)
        if motion is None:
            return
        if before is not None:
            self.on_motion(before, motion)
        self.motion = motion

    def _take_status(self, frame: bytes, received_ns: int) -> None:
        self._keep(parse_status(frame, received_ns))

    def _keep(self, status: StatusReport) -> None:
        before, self.status = self.status, status
        if before is not None:
            self.on_status(before, status)

    def _on_death(self, name: str, failure: BaseException) -> None:
        self.failure = f"The arm's reports ended ({failure}); check power and cable, then confirm."
        with self._news:
            self._news.notify_all()
