"""The port that the SDK is given: replies are read by the thread that waits for them."""

from __future__ import annotations

import socket
from collections.abc import Iterator
from queue import Queue
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.lite6.sdk import ControlPort, _own_port
from hw.lite6.uxbus import UxbusFrame

pytestmark = pytest.mark.waiting

SOON_S = 5.0
FAILED = -1


class Controller:
    """The other end of a port."""

    def __init__(self) -> None:
        with socket.create_server(("127.0.0.1", 0)) as server:
            self.feedback: Queue[bytes] = Queue()
            self.port = ControlPort("127.0.0.1", server.getsockname()[1], self.feedback)
            self.connection, _ = server.accept()

    def close(self) -> None:
        self.port.close()
        self.connection.close()


@pytest.fixture
def controller() -> Iterator[Controller]:
    made = Controller()
    yield made
    made.close()


def reply(transaction: int, register: int = 13) -> bytes:
    return UxbusFrame(transaction, 2, register, b"\x00\x02").encode()


def test_a_request_arrives_as_it_is(controller: Controller) -> None:
    assert controller.port.write(b"request") == 0
    assert controller.connection.recv(64) == b"request"


def test_a_request_that_cannot_be_sent_whole_ends_the_connection(controller: Controller) -> None:
    controller.port.com.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, 4096)
    assert controller.port.write(bytes(50_000_000)) == FAILED  # the other end reads nothing
    assert not controller.port.connected
    assert controller.port.write(b"request") == FAILED


@given(st.lists(st.integers(1, 30), min_size=1, max_size=8))
def test_replies_in_any_pieces_are_read_whole_and_in_order(sizes: list[int]) -> None:
    controller = Controller()
    stream = b"".join(reply(number) for number in range(4))
    while stream:
        for size in sizes:
            controller.connection.sendall(stream[:size])
            stream = stream[size:]
    assert [controller.port.read(SOON_S) for _ in range(4)] == [reply(n) for n in range(4)]
    controller.close()


def test_without_a_reply_it_gives_up_and_the_connection_stays(controller: Controller) -> None:
    assert controller.port.read(0.01) == FAILED
    assert controller.port.connected
    controller.connection.sendall(reply(1))
    assert controller.port.read(SOON_S) == reply(1)


def test_what_is_said_unasked_goes_to_who_waits_for_it(controller: Controller) -> None:
    controller.connection.sendall(reply(1, 0xFF) + reply(2))
    assert controller.port.read(SOON_S) == reply(2)
    assert controller.feedback.get_nowait() == reply(1, 0xFF)


@pytest.mark.parametrize("said", [b"", b"\x00\x01\x00\x02\x00\x01\x0d"])
def test_a_connection_that_ends_or_makes_no_sense_is_lost(
    controller: Controller, said: bytes
) -> None:
    controller.connection.sendall(said)
    controller.connection.shutdown(socket.SHUT_WR)
    assert controller.port.read(SOON_S) == FAILED
    assert not controller.port.connected
    assert controller.port.write(b"request") == FAILED
    assert controller.port.flush() == FAILED


def test_a_closed_port_says_so_and_may_be_closed_again(controller: Controller) -> None:
    controller.port.close()
    controller.port.close()
    assert controller.port.read(SOON_S) == FAILED
    assert controller.port.write(b"request") == FAILED


def test_of_an_arms_name_each_address_is_tried_in_turn(monkeypatch: pytest.MonkeyPatch) -> None:
    """As all other connections to the arm do: one address, the first, was called by the SDK's."""
    base = SimpleNamespace(SocketPort=None)
    with socket.create_server(("127.0.0.1", 0)) as server:
        at = server.getsockname()
        found = [
            (socket.AF_INET, socket.SOCK_STREAM, 6, "", (host, at[1]))
            for host in ("127.0.0.2", "127.0.0.1")  # nothing listens at the first
        ]
        monkeypatch.setattr(socket, "getaddrinfo", lambda *_, **__: found)
        with _own_port(base, "arm.lab", at[1]):
            port = base.SocketPort("127.0.0.2", 0, fb_que=Queue())  # as the SDK calls it
        assert port.com.getpeername() == at
        port.close()
