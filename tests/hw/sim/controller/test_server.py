"""The controller on TCP, by bare sockets; the driver's tests bring UFACTORY's real SDK."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from hw.lite6.protocol import Register
from hw.sim.controller.model import ControllerModel, IdealPlant, ReportKind
from hw.sim.controller.server import ControllerServer
from tams_app.errors import DeviceError
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.hw.lite6.controller_rig import until

pytestmark = pytest.mark.waiting

TIMEOUT_S = 5.0
BYTES = {ReportKind.RICH: 587, ReportKind.REAL: 87}


@pytest.fixture
def server() -> Iterator[ControllerServer]:
    server = ControllerServer(ControllerModel(IdealPlant()))
    server.start()
    yield server
    server.close()
    assert server.failure is None


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
