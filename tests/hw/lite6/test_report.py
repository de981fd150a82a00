"""Report frames and the thread that reads them."""

from __future__ import annotations

import math
import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import ExitStack

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.arm import TcpBoundary
from hw.lite6.report import (
    FrameBuffer,
    ReportReader,
    parse_motion,
    parse_status,
    read_status,
)
from hw.sim.controller.model import ControllerModel, IdealPlant, ReportKind
from hw.sim.controller.server import _bind_reports
from tams_app.errors import DeviceError
from tams_app.runtime.clock import VirtualClock
from tams_app.units import NS_PER_S
from tests.hw.lite6.controller_rig import until

pytestmark = pytest.mark.waiting

MODEL = ControllerModel(IdealPlant())
REAL, RICH = MODEL.report(ReportKind.REAL), MODEL.report(ReportKind.RICH)


# --- frames -------------------------------------------------------------------------------------


@given(st.lists(st.integers(1, 200), max_size=20))
def test_frames_come_out_whole_however_the_stream_is_cut(cuts: list[int]) -> None:
    stream = REAL * 3
    buffer, frames, start = FrameBuffer(len(REAL)), [], 0
    for cut in [*cuts, len(stream)]:
        frames += buffer.feed(stream[start : start + cut])
        start += cut
    assert frames == [REAL] * 3


@pytest.mark.parametrize("length", [0, 86, 5000, 0xFFFFFFFF])
def test_what_is_no_report_is_an_error(length: int) -> None:
    with pytest.raises(ConnectionError):
        FrameBuffer(len(REAL)).feed(struct.pack(">I", length))


def test_motion_reads_the_same_from_every_kind_of_report() -> None:
    for frame in (REAL, RICH):
        motion = parse_motion(frame, 7)
        assert motion is not None
        assert motion.received_ns == 7
        np.testing.assert_allclose(motion.joints, MODEL.joints, atol=1e-6)
        np.testing.assert_allclose(motion.tcp.position, MODEL.tcp[:3, 3], atol=1e-6)
        assert (motion.mode, motion.state) == (0, 4)


def test_the_tcps_roll_pitch_and_yaw_turn_about_x_then_y_then_z_of_the_base() -> None:
    frame = bytearray(REAL)
    struct.pack_into("<3f", frame, 35 + 12, 0.0, 0.0, math.pi / 2)
    motion = parse_motion(bytes(frame), 0)
    assert motion is not None
    np.testing.assert_allclose(motion.tcp.rotation.apply([1, 0, 0]), [0, 1, 0], atol=1e-6)
    struct.pack_into("<3f", frame, 35 + 12, math.pi / 2, 0.0, math.pi / 2)
    both = parse_motion(bytes(frame), 0)
    assert both is not None
    np.testing.assert_allclose(both.tcp.rotation.apply([0, 1, 0]), [0, 0, 1], atol=1e-6)


@pytest.mark.parametrize("nonsense", [math.nan, math.inf])
def test_numbers_that_are_none_make_no_state(nonsense: float) -> None:
    frame = bytearray(REAL)
    struct.pack_into("<f", frame, 11, nonsense)
    assert parse_motion(bytes(frame), 0) is None


def test_the_status_tells_of_errors_motors_and_settings() -> None:
    model = ControllerModel(IdealPlant())
    model.enable(True)
    model.set_tcp_offset((1.0, 2.0, 82.0, 0.0, 0.0, 0.5))
    model.settings.load = (0.35, 0.0, 0.0, 40.0)
    model.settings.collision_sensitivity = 4
    assert parse_status(model.report(ReportKind.RICH), 0).motors_enabled
    model.raise_error(31)
    model.raise_warning(11)
    status = parse_status(model.report(ReportKind.RICH), 9)
    assert (status.error_code, status.warning_code, status.received_ns) == (31, 11, 9)
    np.testing.assert_allclose(status.tcp_offset, [1, 2, 82, 0, 0, 0.5])
    np.testing.assert_allclose(status.load, [0.35, 0, 0, 40])
    assert status.collision_sensitivity == 4
    assert status.gravity == (0.0, 0.0, -1.0)
    assert (status.reduced, status.boundary) == (None, None)
    switches = (status.simulated, status.approximate, status.rebound, status.clears_outputs)
    assert not any(switches)
    assert status.self_collision_check
    assert (status.temperatures_c, status.drive_codes) == ((30,) * 6, (0,) * 6)


def test_the_status_tells_of_settings_that_another_program_made() -> None:
    model = ControllerModel(IdealPlant())
    settings = model.settings
    settings.gravity, settings.world_offset = (0.0, 1.0, 0.0), (1.0, 2.0, 3.0, 0.5, 0.0, 0.25)
    settings.reduced = (50.0, 0.5)
    settings.fence, settings.boundary = True, TcpBoundary((-1, -2, -3), (4, 5, 6))
    settings.collision_rebound = settings.simulation_robot = settings.approximate_motion = True
    settings.self_collision_check, settings.clear_outputs_on_stop = False, True
    model.temperatures_c = (30, 41, -5, 90, 30, 31)
    model.raise_drive_error(3, 15)
    status = parse_status(model.report(ReportKind.RICH), 0)
    assert (status.gravity, status.world_offset) == (settings.gravity, settings.world_offset)
    assert (status.reduced, status.boundary) == ((50.0, 0.5), (4, -1, 5, -2, 6, -3))
    switches = (status.simulated, status.approximate, status.rebound, status.clears_outputs)
    assert all(switches)
    assert not status.self_collision_check
    assert (status.temperatures_c, status.drive_codes) == (
        model.temperatures_c,
        (0, 0, 15, 0, 0, 0),
    )
    assert status.error_code == 13


# --- the reader ---------------------------------------------------------------------------------


class Streams:
    """A controller that says exactly what the test lets it say."""

    def __init__(self, closing: ExitStack) -> None:
        self._closing = closing
        self._listeners = _bind_reports("127.0.0.1", 0)
        for listener in self._listeners.values():
            closing.enter_context(listener)
        self.base = self._listeners[ReportKind.RICH].getsockname()[1] - 1

    def accept(self) -> None:
        self.rich, self.real = self._accepted(ReportKind.RICH), self._accepted(ReportKind.REAL)

    def serve_rich(self, data: bytes) -> None:
        """Answer a client that may come later."""
        with self._accepted(ReportKind.RICH) as connection:
            connection.sendall(data)

    def _accepted(self, kind: ReportKind) -> socket.socket:
        self._listeners[kind].settimeout(5.0)
        return self._closing.enter_context(self._listeners[kind].accept()[0])


@pytest.fixture
def streams() -> Iterator[Streams]:
    with ExitStack() as closing:
        yield Streams(closing)


@pytest.fixture
def clock() -> VirtualClock:
    return VirtualClock()


@pytest.fixture
def reader(streams: Streams, clock: VirtualClock) -> Iterator[ReportReader]:
    made = ReportReader("127.0.0.1", streams.base, clock)
    made.start()
    streams.accept()
    yield made
    made.close()
    made.close()


def test_there_is_no_motion_without_a_status_beside_it(
    streams: Streams, reader: ReportReader
) -> None:
    streams.real.sendall(REAL)
    assert not reader.wait_for(lambda: reader.motion is not None, 0.2)
    streams.rich.sendall(RICH)
    assert reader.wait_for(lambda: reader.status is not None, 5.0)
    streams.real.sendall(REAL)
    assert reader.wait_for(lambda: reader.motion is not None, 5.0)


def test_motion_carries_the_time_of_receipt_and_ages_when_either_stream_falls_silent(
    streams: Streams, reader: ReportReader, clock: VirtualClock
) -> None:
    def received_ns() -> int:
        return reader.motion.received_ns if reader.motion else 0

    streams.rich.sendall(RICH)
    assert reader.wait_for(lambda: reader.status is not None, 5.0)
    clock.advance_ns(NS_PER_S // 2)
    streams.real.sendall(REAL)
    first_ns = clock.now_ns()
    assert reader.wait_for(lambda: received_ns() == first_ns, 5.0)
    clock.advance_ns(NS_PER_S)  # the status is now older than its five periods
    streams.real.sendall(REAL)
    assert not reader.wait_for(lambda: received_ns() != first_ns, 0.2)
    streams.rich.sendall(RICH)
    assert until(lambda: reader.status is not None and reader.status.received_ns > first_ns)
    streams.real.sendall(REAL)
    assert reader.wait_for(lambda: received_ns() == clock.now_ns(), 5.0)


def test_a_closed_stream_is_a_failure_that_waiters_learn_at_once(
    streams: Streams, reader: ReportReader
) -> None:
    streams.real.close()
    assert not reader.wait_for(lambda: False, 5.0)
    assert "reports ended" in reader.failure


def test_nonsense_on_a_stream_is_a_failure(streams: Streams, reader: ReportReader) -> None:
    streams.rich.sendall(b"HTTP/1.1 400 Bad Request\r\n")
    assert until(lambda: "reports ended" in reader.failure)


def test_an_arm_whose_rich_report_ends_early_is_one_sentence(streams: Streams) -> None:
    server = threading.Thread(target=streams.serve_rich, args=(RICH[:100],))
    server.start()
    with pytest.raises(DeviceError, match="no reports"):
        read_status("127.0.0.1", streams.base)
    server.join()
