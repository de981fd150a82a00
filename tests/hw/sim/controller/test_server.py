"""The controller on TCP, driven by UFACTORY's real SDK and by bare sockets."""

from __future__ import annotations

import math
import socket
import struct
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import pytest
from xarm.core.config.x_config import XCONF
from xarm.wrapper import XArmAPI
from xarm.x3.report import ReportDataStructure

from hw.lite6.codes import Register
from hw.sim.controller.model import ControllerModel, IdealPlant, ReportKind
from hw.sim.controller.server import ControllerServer
from tams_app.errors import DeviceError
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.hw.lite6.controller_rig import until

pytestmark = pytest.mark.waiting

READY = [math.radians(angle) for angle in (0, 36.81, 86.74, 0, 49.93, 0)]
TIMEOUT_S = 5.0
BYTES = {ReportKind.NORMAL: 145, ReportKind.RICH: 587, ReportKind.REAL: 87}


@pytest.fixture
def server() -> Iterator[ControllerServer]:
    server = ControllerServer(ControllerModel(IdealPlant(), np.array(READY)))
    server.start()
    yield server
    server.close()
    assert server.failure is None


@pytest.fixture
def model(server: ControllerServer) -> ControllerModel:
    return server._model


@pytest.fixture
def connect_sdk(
    server: ControllerServer, monkeypatch: pytest.MonkeyPatch
) -> Iterator[Callable[..., Any]]:
    """Connects the SDK to the server's unprivileged ports."""
    timeout = socket.getdefaulttimeout()
    ports = server.ports
    create = ReportDataStructure.create
    structures = {ports.report + kind.port_offset: 30001 + kind.port_offset for kind in ReportKind}
    conf = XCONF.SocketConf
    monkeypatch.setattr(conf, "TCP_CONTROL_PORT", ports.control)
    monkeypatch.setattr(conf, "TCP_REPORT_NORM_PORT", ports.report)
    monkeypatch.setattr(conf, "TCP_REPORT_RICH_PORT", ports.report + 1)
    monkeypatch.setattr(conf, "TCP_REPORT_REAL_PORT", ports.report + 2)
    monkeypatch.setattr(
        ReportDataStructure,
        "create",
        lambda port, **options: create(structures[port], **options),
    )
    arms: list[Any] = []

    def connect(report_type: str = "normal") -> Any:
        arm = XArmAPI("127.0.0.1", is_radian=True, report_type=report_type, forbid_uds=True)
        arms.append(arm)
        return arm

    yield connect
    for arm in arms:
        arm.disconnect()
    socket.setdefaulttimeout(timeout)


def enter(arm: Any, mode: int) -> None:
    assert arm.motion_enable(True) == 0
    assert arm.set_mode(mode) == 0
    assert arm.set_state(0) == 0
    # until its report shows the mode, the SDK warns about every command
    assert until(lambda: arm.mode == mode)


@contextmanager
def client(port: int) -> Iterator[socket.socket]:
    with socket.create_connection(("127.0.0.1", port), TIMEOUT_S) as connection:
        yield connection


def receive(connection: socket.socket, count: int) -> bytes:
    received = b""
    while len(received) < count:
        data = connection.recv(count - len(received))
        assert data, "the server hung up"
        received += data
    return received


def ask_state(connection: socket.socket) -> bytes:
    connection.sendall(struct.pack(">HHHB", 1, 2, 1, Register.GET_STATE))
    return receive(connection, 9)


def hung_up(connection: socket.socket) -> bool:
    try:
        return connection.recv(1) == b""
    except ConnectionError:
        return True


# --- with the SDK -------------------------------------------------------------------------------


def test_the_sdk_takes_it_for_a_lite_6(connect_sdk: Callable[..., Any]) -> None:
    arm = connect_sdk()
    assert arm.connected
    assert (arm.axis, arm.device_type) == (6, 9)
    assert arm._arm.version_is_ge(1, 8, 0)
    assert arm.get_state() == (0, 4)
    assert arm.get_err_warn_code() == (0, [0, 0])


def test_the_sdk_configures_it(connect_sdk: Callable[..., Any], model: ControllerModel) -> None:
    arm = connect_sdk()
    enter(arm, 0)
    assert arm.set_tcp_offset([0, 0, 82, 0, 0, 0]) == 0
    assert arm.get_state() == (0, 5)
    assert arm.set_state(0) == 0
    assert arm.set_tcp_load(0.35, [0, 0, 40]) == 0
    assert arm.get_state() == (0, 5)
    assert arm.set_collision_sensitivity(4) == 0
    assert arm.get_state() == (0, 2)  # the SDK itself sets state 0
    assert arm.set_reduced_tcp_boundary([400, 150, 300, -300, 500, 10]) == 0
    assert arm.set_fence_mode(True) == [0]
    code, position = arm.get_position()
    assert code == 0
    assert position[:3] == pytest.approx([350, 0, 180], abs=0.2)
    assert until(lambda: arm.tcp_offset[2] == 82)
    assert arm.tcp_load == [pytest.approx(0.35), [0, 0, 40]]
    assert until(lambda: arm.collision_sensitivity == 4)
    assert arm.get_reduced_states()[1][1] == [400, 150, 300, -300, 500, 10]


def test_the_sdk_waits_for_a_joint_move(connect_sdk: Callable[..., Any]) -> None:
    arm = connect_sdk()
    enter(arm, 0)
    goal = [0.2, *READY[1:]]
    assert until(lambda: arm.state == 2)
    assert arm.set_servo_angle(angle=goal, speed=2.0, mvacc=10, wait=True, timeout=TIMEOUT_S) == 0
    code, joints = arm.get_servo_angle()
    assert code == 0
    assert joints[:6] == pytest.approx(goal, abs=1e-4)


def test_an_old_firmware_gets_no_deadman_time_from_the_sdk(
    connect_sdk: Callable[..., Any], model: ControllerModel
) -> None:
    model.firmware = "1.7.4"
    arm = connect_sdk()
    assert not arm._arm.version_is_ge(1, 8, 0)
    enter(arm, 5)
    arm.vc_set_cartesian_velocity([0, 5, 0, 0, 0, 0], duration=0.05)
    time.sleep(0.4)
    assert model.moving


@pytest.mark.parametrize("report_type", ["real", "rich"])
def test_the_sdk_reads_every_report(
    connect_sdk: Callable[..., Any], report_type: str, model: ControllerModel
) -> None:
    arm = connect_sdk(report_type)
    enter(arm, 5)
    assert until(lambda: (arm.mode, arm.state) == (5, 2))
    assert arm.angles[:6] == pytest.approx(READY, abs=1e-5)
    assert arm.position[:3] == pytest.approx(model.tcp[:3, 3] * 1000, abs=0.01)


# --- bare sockets -------------------------------------------------------------------------------


@pytest.mark.parametrize("nonsense", [b"GET / HTTP/1.1\r\n\r\n", b"\xff" * 64, bytes(6)])
def test_nonsense_costs_the_connection_and_nothing_else(
    server: ControllerServer, nonsense: bytes
) -> None:
    with client(server.ports.control) as rude, client(server.ports.control) as polite:
        rude.sendall(nonsense)
        assert hung_up(rude)
        assert ask_state(polite)[-1] == 4
    assert server.failure is None


def test_a_heartbeat_gets_no_answer(server: ControllerServer) -> None:
    with client(server.ports.control) as connection:
        connection.sendall(bytes([0, 0, 0, 1, 0, 2, 0, 0]))
        assert ask_state(connection)[:2] == b"\0\x01"


def test_several_clients_get_the_reports_at_once(server: ControllerServer) -> None:
    for kind, size in BYTES.items():
        port = server.ports.report + kind.port_offset
        with client(port) as one, client(port) as other:
            for connection in (one, other):
                for _ in range(2):
                    assert struct.unpack(">I", receive(connection, size)[:4]) == (size,)


class HandClock:
    """A clock that sleepers wait on until a test moves it."""

    def __init__(self) -> None:
        self._now_ns = NS_PER_S
        self._moved = threading.Condition()

    def now_ns(self) -> int:
        return self._now_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        with self._moved:
            self._moved.wait_for(lambda: self._now_ns >= deadline_ns, TIMEOUT_S)

    def suspended_ns(self) -> int:
        return 0

    def advance_ms(self, duration_ms: int) -> None:
        with self._moved:
            self._now_ns += duration_ms * NS_PER_MS
            self._moved.notify_all()


class CountingPlant(IdealPlant):
    """Counts the cycles of the controller that drives it."""

    def __init__(self) -> None:
        self.cycles = 0

    def step(self, *arguments: Any) -> Any:
        self.cycles += 1
        return super().step(*arguments)


def test_the_model_s_time_follows_the_clock_and_catches_up_after_a_standstill() -> None:
    clock, plant = HandClock(), CountingPlant()
    server = ControllerServer(ControllerModel(plant), clock=clock)
    server.start()
    clock.advance_ms(4)
    assert until(lambda: plant.cycles == 1)
    clock.advance_ms(800)
    assert until(lambda: plant.cycles == 201)
    clock.advance_ms(3_000)
    assert until(lambda: plant.cycles >= 452)
    clock.advance_ms(4)
    server.close()
    assert plant.cycles < 460, "without the 499 that were due more than a second before"


def test_closing_frees_the_ports_and_ends_the_threads() -> None:
    server = ControllerServer(ControllerModel(IdealPlant()))
    server.start()
    ports = server.ports
    with client(ports.control) as connection:
        ask_state(connection)
        server.close()
        server.close()
        assert hung_up(connection)
    names = [thread.name for thread in threading.enumerate()]
    assert not [name for name in names if name.startswith("arm-controller")]
    again = ControllerServer(
        ControllerModel(IdealPlant()), control_port=ports.control, report_port=ports.report
    )
    again.start()
    assert again.ports == ports
    again.close()


def test_a_port_that_is_taken_is_one_sentence(server: ControllerServer) -> None:
    twin = ControllerServer(ControllerModel(IdealPlant()), control_port=server.ports.control)
    with pytest.raises(DeviceError, match="cannot listen"):
        twin.start()
    twin = ControllerServer(ControllerModel(IdealPlant()), report_port=server.ports.report)
    with pytest.raises(DeviceError, match="cannot listen"):
        twin.start()
    twin.close()


def test_a_broken_plant_is_told_to_the_owner() -> None:
    class BrokenPlant(IdealPlant):
        def step(self, *arguments: Any) -> Any:
            raise RuntimeError("the plant broke")

    ended = threading.Event()
    server = ControllerServer(ControllerModel(BrokenPlant()), ended=ended)
    server.start()
    assert ended.wait(TIMEOUT_S)
    server.close()
    assert isinstance(server.failure, RuntimeError)
