"""The stop's own connection, and the protocol it speaks."""

from __future__ import annotations

import socket
import struct
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import pytest

from hw.lite6.protocol import Register, UxbusClient
from hw.lite6.stop_channel import Lite6StopChannel
from tests.hw.lite6.controller_rig import ControllerRig, controller, until
from tests.tcp_relay import TcpRelay

pytestmark = pytest.mark.waiting


@pytest.fixture
def rig() -> Iterator[ControllerRig]:
    with controller() as made:
        yield made


@pytest.fixture
def channel(rig: ControllerRig) -> Iterator[Lite6StopChannel]:
    rig.make_ready()
    made = Lite6StopChannel("127.0.0.1", rig.config().control_port, 0.5, "arm-stop")
    made.start()
    yield made
    made.close()
    made.close()


def test_each_stop_is_a_new_one(rig: ControllerRig, channel: Lite6StopChannel) -> None:
    for _ in range(3):
        rig.make_ready()
        assert not rig.stopped
        channel.request_stop()
        assert channel.wait_acknowledged(10.0)
        assert rig.stopped


def test_a_stop_asked_for_during_a_stop_is_sent_after_it(
    rig: ControllerRig, channel: Lite6StopChannel
) -> None:
    stops: list[int] = []

    def ask_again(register: int, _: bytes) -> None:
        if register == Register.SET_STATE:
            stops.append(register)
            if len(stops) == 1:
                channel.request_stop()

    rig.intercept(ask_again)
    channel.request_stop()
    assert channel.wait_acknowledged(10.0)
    assert len(stops) == 2


def test_a_stop_over_a_broken_connection_is_repeated_over_a_new_one(
    rig: ControllerRig, channel: Lite6StopChannel
) -> None:
    rig.server.refuse_connections = True
    rig.server.drop_connections()
    channel.request_stop()
    assert until(lambda: "does not answer" in channel.failure)
    assert channel.pending
    rig.server.refuse_connections = False
    assert channel.wait_acknowledged(10.0)
    assert rig.stopped
    assert channel.failure == ""


def test_an_idle_channel_that_would_not_work_says_so(
    rig: ControllerRig, channel: Lite6StopChannel
) -> None:
    rig.server.refuse_connections = True
    rig.server.drop_connections()
    assert until(lambda: "stop connection" in channel.failure)
    rig.server.refuse_connections = False
    assert until(lambda: channel.failure == "")


@pytest.fixture
def relay(rig: ControllerRig) -> Iterator[TcpRelay]:
    """Between the channel and the arm; what it holds stays open and falls silent."""
    made = TcpRelay(rig.config().control_port)
    yield made
    made.close()


def test_a_stop_gives_up_a_connection_that_is_open_but_silent(
    rig: ControllerRig, relay: TcpRelay
) -> None:
    rig.make_ready()
    channel = Lite6StopChannel("127.0.0.1", relay.port, 0.1, "arm-stop")
    channel.start()
    relay.hold_present()
    channel.request_stop()
    assert channel.wait_acknowledged(10.0)
    assert rig.stopped
    assert channel.failure == ""
    channel.close()


def test_an_idle_channel_gives_up_a_connection_that_is_open_but_silent(
    rig: ControllerRig, relay: TcpRelay
) -> None:
    channel = Lite6StopChannel("127.0.0.1", relay.port, 0.1, "arm-stop")
    channel.start()
    relay.hold_present()
    assert until(lambda: "does not answer" in channel.failure)
    assert until(lambda: channel.failure == "")
    channel.close()


def test_a_slow_arm_is_given_time_to_acknowledge(rig: ControllerRig) -> None:
    rig.make_ready()
    channel = Lite6StopChannel("127.0.0.1", rig.config().control_port, 0.02, "arm-stop")
    channel.start()
    rig.server.reply_delay_s = 0.2
    channel.request_stop()
    assert channel.wait_acknowledged(10.0)
    channel.close()


# --- the protocol -------------------------------------------------------------------------------

Script = Callable[[socket.socket], None]


@contextmanager
def peer(script: Script) -> Iterator[UxbusClient]:
    """A client connected to a server that runs `script` on the connection."""
    with socket.create_server(("127.0.0.1", 0)) as listener:
        listener.settimeout(5.0)

        def serve() -> None:
            connection, _ = listener.accept()
            with connection:
                connection.settimeout(5.0)
                script(connection)

        server = threading.Thread(target=serve)
        server.start()
        client = UxbusClient("127.0.0.1", listener.getsockname()[1])
        client.connect()
        yield client
        client.close()
        server.join()


def read_request(connection: socket.socket) -> tuple[int, bytes]:
    data = connection.recv(1024)
    transaction, protocol, length = struct.unpack_from(">HHH", data)
    assert protocol == 2
    assert len(data) == 6 + length
    return transaction, data[6:]


def reply(transaction: int, register: int, data: bytes = b"") -> bytes:
    body = bytes([register, 0]) + data
    return struct.pack(">HHH", transaction, 2, len(body)) + body


def test_a_reply_in_pieces_is_put_together() -> None:
    def script(connection: socket.socket) -> None:
        transaction, _ = read_request(connection)
        for byte in reply(transaction, Register.GET_STATE, b"\x02"):
            connection.sendall(bytes([byte]))

    with peer(script) as client:
        assert client.request(Register.GET_STATE, b"", 5.0)[1] == b"\x02"


def test_a_late_reply_is_not_taken_for_the_next_ones() -> None:
    def script(connection: socket.socket) -> None:
        first, _ = read_request(connection)
        second, _ = read_request(connection)
        connection.sendall(
            reply(first, Register.GET_STATE, b"\x01") + reply(second, Register.GET_STATE, b"\x04")
        )

    with peer(script) as client:
        with pytest.raises(TimeoutError):
            client.request(Register.GET_STATE, b"", 0.05)
        assert client.request(Register.GET_STATE, b"", 5.0)[1] == b"\x04"


@pytest.mark.parametrize("answer", [b"", bytes(8)], ids=["hangs up", "talks nonsense"])
def test_a_peer_that_is_no_arm_is_a_connection_error(answer: bytes) -> None:
    def script(connection: socket.socket) -> None:
        read_request(connection)
        connection.sendall(answer)

    with peer(script) as client:
        with pytest.raises(ConnectionError):
            client.request(Register.GET_STATE, b"", 5.0)
        assert not client.connected
        with pytest.raises(ConnectionError):
            client.request(Register.GET_STATE, b"", 5.0)


def test_a_connection_made_anew_asks_no_name_server(monkeypatch: pytest.MonkeyPatch) -> None:
    """It may hang by then, and the stop would wait for it."""
    asked: list[str] = []
    look_up = socket.getaddrinfo

    def noted(host: str, *more: Any, **named: Any) -> Any:
        asked.append(host)
        return look_up(host, *more, **named)

    monkeypatch.setattr(socket, "getaddrinfo", noted)
    with socket.create_server(("127.0.0.1", 0)) as server:
        client = UxbusClient("localhost", server.getsockname()[1])
        client.connect()
        client.connect()
        client.close()
    assert asked == ["localhost", "127.0.0.1"]
