"""The SDK as it is loaded here, quiet and without traces, and the port that it is given."""

from __future__ import annotations

import os
import socket
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from queue import Queue
from types import SimpleNamespace

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.lite6.protocol import NOTHING_GETS_THROUGH, Code, Mode, UxbusFrame
from hw.lite6.sdk import (
    ControlPort,
    _own_port,
    connect_sdk,
    disconnect_sdk,
    note_mode,
    set_cartesian_velocity,
)
from tests.hw.lite6 import controller_rig

pytestmark = pytest.mark.waiting

LOAD = """
import os, sys
before = dict(os.environ)
from hw.lite6.sdk import _load
_load()
assert dict(os.environ) == before
print("loaded", "xarm" in sys.modules)
"""


def load_with_home(home: str, directory: Path) -> str:
    environment = {**os.environ, "HOME": home, "TMPDIR": str(directory)}
    loaded = subprocess.run(
        [sys.executable, "-W", "error", "-c", LOAD],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    assert loaded.stderr == ""
    return loaded.stdout


def test_loading_prints_nothing_and_leaves_no_folder_in_the_home(tmp_path: Path) -> None:
    home, temporary = tmp_path / "home", tmp_path / "temporary"
    home.mkdir()
    temporary.mkdir()
    assert load_with_home(str(home), temporary) == "loaded True\n"
    assert list(home.iterdir()) == []
    assert list(temporary.iterdir()) == []


def test_it_loads_where_the_home_cannot_be_written_or_is_empty(tmp_path: Path) -> None:
    for home in ("/proc/no-such-home", ""):
        assert load_with_home(home, tmp_path) == "loaded True\n"


def test_the_sdks_own_port_is_put_back_at_once() -> None:
    with controller_rig.controller() as rig:
        api = connect_sdk("localhost", rig.config().control_port)
        from xarm.core.comm import SocketPort
        from xarm.x3 import base

        assert api.connected
        assert base.SocketPort is SocketPort
        disconnect_sdk(api)
        assert not api.connected


def test_a_velocity_is_sent_and_answered_as_by_the_sdks_own_call() -> None:
    speeds, duration_s = [12.5, -3.0, 0.25, 0.1, -0.2, 0.3], 0.1
    with controller_rig.controller() as rig:
        api = connect_sdk("localhost", rig.config().control_port)
        port = api._arm.arm_cmd.arm_port
        frames: list[bytes] = []
        write = port.write
        port.write = lambda frame: (frames.append(frame), write(frame))[1]

        def both() -> list[int]:
            frames.clear()
            theirs = api.vc_set_cartesian_velocity(speeds, is_radian=True, duration=duration_s)
            return [theirs, set_cartesian_velocity(api, speeds, duration_s)]

        assert both() == [Code.INVALID] * 2  # the mode is another
        api.motion_enable(True)
        api.set_mode(Mode.CARTESIAN_VELOCITY)
        note_mode(api, Mode.CARTESIAN_VELOCITY)
        assert both() == [Code.NOT_READY] * 2
        api.set_state(0)
        assert both() == [Code.OK] * 2
        read, late = port.read, [b"\0\0\0\2\0\2\x52\0"]  # the reply to an earlier command
        port.read = lambda timeout: late.pop() if late else read(timeout)
        assert set_cartesian_velocity(api, speeds, duration_s) == Code.OK
        assert not late
        port.read = lambda timeout: -1
        assert set_cartesian_velocity(api, speeds, duration_s) == Code.TIMEOUT
        port.read = read
        theirs, ours = frames[:2]
        assert ours[2:] == theirs[2:]  # all but the number of the transaction
        assert int.from_bytes(ours[:2]) == int.from_bytes(theirs[:2]) + 1
        port.close()
        assert set(both()) <= NOTHING_GETS_THROUGH
        disconnect_sdk(api)


# --- its port: replies are read by the thread that waits for them -------------------------------

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
