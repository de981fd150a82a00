"""A name with several addresses: all are called, and the one that answers counts."""

from __future__ import annotations

import os
import socket
from typing import Any

import pytest

from tams_app.console.options import endpoint_of
from tams_app.errors import ConfigError
from tams_app.link import addresses
from tams_app.link.addresses import addresses_of, called, is_loopback, named
from tams_app.link.caller import Caller
from tests.link.rig import DESK, KEY, robot

pytestmark = pytest.mark.untimed

V6, V4 = ("::1", 7300, 0, 0), ("127.0.0.1", 7300)
MAPPED = ("::ffff:127.0.0.1", 7300, 0, 0)
ELSEWHERE = ("::ffff:192.0.2.9", 7300, 0, 0)


def names(monkeypatch: pytest.MonkeyPatch, *found: tuple[Any, ...]) -> None:
    """Whatever is asked for has these addresses."""
    answer = [
        (socket.AF_INET6 if len(one) == 4 else socket.AF_INET, socket.SOCK_DGRAM, 17, "", one)
        for one in found
    ]
    monkeypatch.setattr(addresses.socket, "getaddrinfo", lambda *_, **__: answer)


def test_one_socket_reaches_all_addresses_of_a_name(monkeypatch: pytest.MonkeyPatch) -> None:
    names(monkeypatch, V6, V4, V4)
    assert addresses_of("robot.lab", 7300) == (socket.AF_INET6, (V6, MAPPED))
    names(monkeypatch, V4)
    assert addresses_of("robot.lab", 7300) == (socket.AF_INET, (V4,))


def test_a_name_is_shown_with_the_addresses_that_are_called(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    names(monkeypatch, V6, V4)
    assert called("robot.lab", 7300) == "robot.lab:7300 ([::1]:7300, 127.0.0.1:7300)"
    names(monkeypatch, V4)
    assert called("127.0.0.1", 7300) == "127.0.0.1:7300"
    assert named(MAPPED) == "127.0.0.1:7300"


def test_without_a_key_a_name_is_called_only_if_all_its_addresses_are_this_computers(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    names(monkeypatch, V6, V4)
    assert endpoint_of("--robot", "localhost:7300", None).host == "localhost"
    assert all(map(is_loopback, addresses_of("localhost", 7300, loopback_only=True)[1]))
    names(monkeypatch, V6, ("192.0.2.9", 7300))
    with pytest.raises(ConfigError, match="--key is needed"):
        endpoint_of("--robot", "localhost:7300", None)
    with pytest.raises(OSError, match="a key is needed"):
        addresses_of("localhost", 7300, loopback_only=True)


class Names:
    """An operator's end that calls a name with two addresses; the robot listens at the second."""

    def __init__(self) -> None:
        self.end = Caller(KEY, [V6, MAPPED], os.urandom)
        self.robot = robot()
        self.now_ns = 10**12
        self.seen: list[tuple[bytes, Any]] = []

    def goes(self, sent: list[tuple[bytes, Any]], source: Any = MAPPED) -> None:
        """Carry these to the robot, and what it answers back, as from `source`."""
        for datagram, to in sent:
            self.seen.append((datagram, to))
            if to != MAPPED:
                continue
            for reply, _ in self.robot.receive(datagram, DESK, self.now_ns).replies:
                self.goes(self.end.receive(reply, source, self.now_ns).replies, source)


def test_the_address_that_answers_is_the_one_that_is_talked_to() -> None:
    rig = Names()
    rig.goes(rig.end.step(rig.now_ns))
    assert [to for _, to in rig.seen[:3]] == [V6, MAPPED, MAPPED]  # the last one with the proof
    assert {to for _, to in rig.seen[1:]} == {MAPPED}
    assert (rig.end.connected, rig.end.address) == (True, MAPPED)


def test_an_answer_from_elsewhere_moves_nothing_to_there() -> None:
    """Who is on the way can send a real answer from any address."""
    rig = Names()
    rig.goes(rig.end.step(rig.now_ns), ELSEWHERE)
    assert {to for _, to in rig.seen} == {V6, MAPPED}
    assert rig.end.address == MAPPED


def test_what_comes_from_one_address_does_not_keep_the_other_from_answering() -> None:
    rig = Names()
    sent = rig.end.step(rig.now_ns)
    at_six = sent[0][0]
    source = at_six[15 : 15 + at_six[14]]
    for first in (0xC0, 0xE0, 0xF0, 0x40):
        forged = bytes((first, 0, 0, 0, 1, 8)) + source + b"\x08" + os.urandom(60)
        rig.goes(rig.end.receive(forged, V6, rig.now_ns).replies)
    rig.goes(sent)
    assert rig.end.address == MAPPED
