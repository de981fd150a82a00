"""A viewer that connects while a session runs hears the channels of its log."""

from __future__ import annotations

import ipaddress
import json
import logging
import socket
import struct
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import psutil
import pytest
from websockets.exceptions import InvalidStatus
from websockets.sync.client import ClientConnection, connect

from tams_app.config import load_config
from tams_app.errors import ConfigError, SetupError
from tams_app.recording import Recorder, read_log
from tams_app.recording.mcap_log import McapLog
from tams_app.records import Note
from tams_app.runtime.clock import MonotonicClock
from tams_app.session.viewing import check_viewers, invitations, viewers_of
from tams_app.telemetry.gate import MOST_VIEWERS, hidden_host, refusal
from tams_app.units import NS_PER_S
from tests.free_port import free_port
from tests.synthetic_session import START_NS, header, never_fails, tick
from tests.telemetry.test_telemetry import shown_frames

pytestmark = pytest.mark.waiting

PROTOCOL = "foxglove.sdk.v1"
MESSAGE_DATA = 1  # opcode; then the subscription's id (4 bytes) and the log time (8 bytes)
DEADLINE_S = 20.0


def recorder(path: Path, port: int) -> Recorder:
    config = load_config(None, {"recording.foxglove": f"127.0.0.1:{port}"})
    log = McapLog(path, header(), True, *viewers_of(config, header()))
    made = Recorder(log, MonotonicClock(), never_fails)
    made.start()
    return made


@pytest.fixture(scope="module")
def port(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """Where a log is served that is written meanwhile."""
    port = free_port()
    log = recorder(tmp_path_factory.mktemp("log") / "session.mcap", port)
    yield port
    log.close()


def channels(viewer: ClientConnection) -> dict[str, dict[str, Any]]:
    """What the server says it has, by topic."""
    found: dict[str, dict[str, Any]] = {}
    while "/shown/eih" not in found or "/tf" not in found or "/note" not in found:
        told = viewer.recv(DEADLINE_S)
        if isinstance(told, str) and (content := json.loads(told))["op"] == "advertise":
            found |= {one["topic"]: one for one in content["channels"]}
    return found


def waiting(viewer: ClientConnection) -> Iterator[str | bytes]:
    """What the server has sent, until nothing has come for a tenth of a second."""
    with suppress(TimeoutError):
        while True:
            yield viewer.recv(0.1)


def test_a_viewer_hears_what_the_log_keeps_while_it_is_written(tmp_path: Path) -> None:
    port = free_port()
    log = recorder(tmp_path / "session.mcap", port)
    notes = [Note(START_NS + number, "info", f"note {number}") for number in range(50)]
    log.record(notes[0])  # a channel of ours is there from its first record on
    log.record(tick(0))
    with connect(f"ws://127.0.0.1:{port}", subprotocols=[PROTOCOL], max_size=None) as viewer:
        offered = channels(viewer)
        assert offered["/log"]["schemaName"] == "foxglove.Log"
        wanted = {7: "/note", 8: "/log", 9: "/tf", 10: "/shown/eih"}
        subscriptions = [
            {"id": number, "channelId": offered[topic]["id"]} for number, topic in wanted.items()
        ]
        wish = json.dumps({"op": "subscribe", "subscriptions": subscriptions})
        viewer.send(wish)
        heard: dict[str, list[bytes]] = {topic: [] for topic in wanted.values()}
        begun_s = time.monotonic()
        frames = [frame for frame in shown_frames(2) if frame.view == "eih"]
        number = 0
        while not all(heard.values()):  # the subscription is in force some time after it was sent
            assert time.monotonic() - begun_s < DEADLINE_S, heard
            number += 1
            log.record(notes[number % 50])
            log.record(tick(number * 4))
            frame = frames[number % len(frames)]
            log.record(replace(frame, shown_ns=START_NS + number * NS_PER_S))
            for told in waiting(viewer):  # all of it: a server lets a slow viewer miss messages
                if isinstance(told, str) and "Unknown channel ID" in told:
                    viewer.send(wish)  # the SDK offers a new channel just before it knows it
                elif isinstance(told, bytes) and told[0] == MESSAGE_DATA:
                    (subscription,) = struct.unpack_from("<I", told, 1)
                    heard[wanted[subscription]].append(told[13:])
    assert json.loads(heard["/note"][0])["text"].startswith("note ")
    assert b"\xff\xd8\xff" in heard["/shown/eih"][0]  # a JPEG
    log.close()
    assert log.dropped == 0
    assert len(read_log(tmp_path / "session.mcap").notes) == number + 1


def test_when_the_log_ends_the_viewer_is_let_go_and_the_port_is_free(tmp_path: Path) -> None:
    port = free_port()
    log = recorder(tmp_path / "one.mcap", port)
    with connect(f"ws://127.0.0.1:{port}", subprotocols=[PROTOCOL]):
        log.close()
    recorder(tmp_path / "two.mcap", port).close()


def test_what_the_sdk_tells_of_viewers_is_not_for_the_operator_s_terminal(tmp_path: Path) -> None:
    port = free_port()
    log = recorder(tmp_path / "session.mcap", port)
    with connect(f"ws://127.0.0.1:{port}", subprotocols=[PROTOCOL]) as viewer:
        viewer.recv(DEADLINE_S)
        viewer.socket.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, struct.pack("ii", 1, 0))
        viewer.socket.close()  # without a word
    log.close()
    assert not [name for name in logging.root.manager.loggerDict if name.startswith("foxglove")]


def status_for(port: int, origin: str | None) -> int:
    """The HTTP status with which the server answers who asks to connect."""
    try:
        with connect(f"ws://127.0.0.1:{port}", subprotocols=[PROTOCOL], origin=origin):
            return 101
    except InvalidStatus as refused:
        return refused.response.status_code


@pytest.mark.parametrize(
    ("origin", "status"),
    [
        (None, 101),
        ("https://app.foxglove.dev", 101),
        ("file://", 101),
        ("https://evil.example", 403),
        ("http://app.foxglove.dev", 403),
        ("https://app.foxglove.dev.evil.example", 403),
        ("http://127.0.0.1:8765", 403),
        ("null", 403),  # of a sandboxed frame in any page
    ],
)
def test_web_pages_of_other_origins_do_not_see_the_session(
    port: int, origin: str | None, status: int
) -> None:
    assert status_for(port, origin) == status


def test_a_web_page_finds_no_second_way_in(tmp_path: Path) -> None:
    """The SDK's own server is not at an address that a page could guess."""
    before = {one.laddr for one in psutil.Process().net_connections("tcp")}
    port = free_port()
    log = recorder(tmp_path / "session.mcap", port)
    listening = {
        one.laddr
        for one in psutil.Process().net_connections("tcp")
        if one.status == psutil.CONN_LISTEN and one.laddr not in before
    }
    log.close()
    known = {("127.0.0.1", port)}
    assert known < listening
    assert len({address.ip for address in listening - known} - {"127.0.0.1", "0.0.0.0"}) == 1
    assert len({hidden_host() for _ in range(100)}) > 90
    assert all(ipaddress.ip_address(hidden_host()).is_loopback for _ in range(100))


def test_only_so_many_viewers_are_served_and_each_that_leaves_makes_room(port: int) -> None:
    with ExitStack() as viewers:
        for _ in range(MOST_VIEWERS):
            viewer = connect(f"ws://127.0.0.1:{port}", subprotocols=[PROTOCOL])
            viewers.enter_context(viewer)
        assert status_for(port, None) == 503
    begun_s = time.monotonic()
    while status_for(port, None) != 101:  # the last ones have left some time after they closed
        assert time.monotonic() - begun_s < DEADLINE_S


def test_who_asks_for_nothing_is_let_go_and_keeps_no_viewer_out(port: int) -> None:
    silent = [socket.create_connection(("127.0.0.1", port)) for _ in range(20)]
    long = socket.create_connection(("127.0.0.1", port))
    long.sendall(b"GET / HTTP/1.1\r\n" + b"X: " + b"x" * 20_000)
    assert status_for(port, None) == 101
    for caller in silent:
        caller.settimeout(DEADLINE_S)
        assert caller.recv(1) == b""
        caller.close()
    long.close()


def test_two_origins_in_one_request_are_one_too_many() -> None:
    twice = b"GET / HTTP/1.1\r\nOrigin: file://\r\norigin: https://evil.example\r\n\r\n"
    assert refusal(twice, ["file://", "https://evil.example"], 0) is not None


def test_a_log_whose_viewers_cannot_be_served_leaves_nothing_open(tmp_path: Path) -> None:
    with (
        socket.create_server(("127.0.0.1", 0)) as taken,
        pytest.raises(SetupError, match=r"nothing can connect at 127\.0\.0\.1:\d+ .*in use"),
    ):
        recorder(tmp_path / "session.mcap", taken.getsockname()[1])


@pytest.mark.parametrize(
    "text", ["8765", "localhost", "localhost:", ":8765", "localhost:0", "h:70000", "h:x"]
)
def test_what_is_no_address_is_told(text: str) -> None:
    with pytest.raises(ConfigError, match=r"^--foxglove: '.*' is not HOST:PORT"):
        check_viewers(load_config(None, {"recording.foxglove": text}))


def test_an_address_of_another_computer_is_told() -> None:
    config = load_config(None, {"recording.foxglove": "192.0.2.1:8765"})  # TEST-NET-1, RFC 5737
    with pytest.raises(SetupError, match="another HOST:PORT of this computer"):
        check_viewers(config)


@pytest.mark.parametrize(
    ("address", "level", "sentence"),
    [
        ("127.0.0.1:8765", "info", "Foxglove may connect to {url}"),
        ("localhost:8765", "info", "Foxglove may connect to {url}"),
        ("[::1]:8765", "info", "Foxglove may connect to {url}"),
        ("0.0.0.0:8765", "warning", "all who reach {url} see this session: no password is asked"),
    ],
)
def test_it_is_said_where_viewers_connect_and_who_else_could(
    address: str, level: str, sentence: str
) -> None:
    config = load_config(None, {"recording.foxglove": address})
    assert list(invitations(config)) == [(level, sentence.format(url=f"ws://{address}"))]


def test_without_an_address_nothing_is_served() -> None:
    assert list(invitations(load_config())) == []
    check_viewers(load_config())
