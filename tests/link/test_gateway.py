"""The gateway as a process: real sockets, a real key file, and strangers at its port."""

from __future__ import annotations

import base64
import os
import random
import signal
import socket
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import msgspec
import pytest

from tams_app.errors import HelperError
from tams_app.link.door import Door
from tams_app.link.gateway import _MEDIA_CLASS, Carrier, Streams
from tams_app.link.gateway_client import Endpoint, Gateway, LinkEvent, Received, Routes
from tams_app.link.identity import read_identity
from tams_app.link.keys import LOOPBACK_KEY, new_key, read_key, revoke_key
from tams_app.runtime.clock import VirtualClock
from tams_app.units import NS_PER_S
from tests.link.gateways import LOOPBACK, Network, Pair, port_of, udp
from tests.link.rig import hostile, is_call, is_long, rtcp, rtp, shown

pytestmark = pytest.mark.waiting

OTHERS_SSRC = 99
IPV4_CLASS = ((socket.IPPROTO_IP, socket.IP_RECVTOS), socket.IP_TOS)
IPV6_CLASS = ((socket.IPPROTO_IPV6, socket.IPV6_RECVTCLASS), socket.IPV6_TCLASS)
BATCH = 500  # hostile datagrams, then a message must pass


@pytest.fixture
def stack() -> Iterator[ExitStack]:
    with ExitStack() as opened:
        yield opened


@pytest.fixture
def key(tmp_path: Path) -> Path:
    new_key(tmp_path / "arm.key")
    return tmp_path / "arm.key"


@pytest.fixture
def pair(stack: ExitStack, tmp_path: Path, key: Path) -> Pair:
    return Pair(stack, tmp_path, key)


# --- what it carries ------------------------------------------------------------------------------


def test_messages_pass_both_ways(pair: Pair) -> None:
    operator = pair.operator()
    assert operator.event.welcome == b"welcome"
    for number in range(20):
        pair.passes(operator, pair.robot, f"up {number}".encode())
        pair.passes(pair.robot, operator, f"down {number}".encode())
    event = pair.robot.event
    assert event.introduction == b"from the operator"
    assert (event.connected, event.sessions, event.left) == (True, 1, False)
    assert event.address == f"{LOOPBACK}:{operator.port}"
    assert (event.operator, event.revoked, operator.event.operator) == ("arm", False, "")


def test_a_message_tells_when_it_was_heard_and_in_which_session(pair: Pair) -> None:
    operator = pair.operator()
    pair.until(lambda: pair.robot.event.connected, lambda: operator.send(b"first"))
    pair.take()
    operator.send(b"second")
    received = []
    pair.heard.pop(pair.robot)
    pair.until(lambda: bool(received), lambda: received.extend(pair.robot.receive()))
    assert {one.session for one in received} == {1}
    times = [one.heard_ns for one in received]
    assert times == sorted(times)


def test_seconds_of_messages_wait_for_an_application_that_stalls(stack: ExitStack) -> None:
    gateway = Gateway("robot", Endpoint(LOOPBACK, 0, None), b"", None)
    stack.callback(gateway.close)
    sent = [f"{number:04}".encode() * 50 for number in range(250)]
    for number, message in enumerate(sent):  # as the process sends them
        gateway._theirs.send(msgspec.msgpack.encode(Received(number, 1, message)))
    received = gateway.receive()
    assert [one.content for one in received] == sent
    assert [one.heard_ns for one in received] == list(range(250))


@pytest.mark.parametrize(
    ("families", "host", "address", "asked", "option"),
    [
        ((socket.AF_INET, socket.AF_INET), LOOPBACK, LOOPBACK, *IPV4_CLASS),
        ((socket.AF_INET6, socket.AF_INET), LOOPBACK, f"::ffff:{LOOPBACK}", *IPV4_CLASS),
        ((socket.AF_INET6, socket.AF_INET6), "::1", "::1", *IPV6_CLASS),
    ],
    ids=["IPv4", "mapped", "IPv6"],
)
def test_messages_have_a_higher_traffic_class_than_video(
    stack: ExitStack,
    families: tuple[int, int],
    host: str,
    address: str,
    asked: tuple[int, int],
    option: int,
) -> None:
    outer, other = (
        stack.enter_context(socket.socket(family, socket.SOCK_DGRAM)) for family in families
    )
    other.bind((host, 0))
    other.settimeout(30.0)
    other.setsockopt(*asked, 1)
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_DGRAM)
    stack.callback(theirs.close)
    streams = Streams()
    carrier = Carrier(Door({}, shown(), b"", os.urandom), outer, ours, streams)
    stack.callback(carrier.close)

    def traffic_class() -> int:
        _, ancillary, _, _ = other.recvmsg(100, 100)
        (value,) = (data for level, kind, data in ancillary if (level, kind) == (asked[0], option))
        return value[0]

    to = (address, other.getsockname()[1])
    carrier._send([(b"a message", to)])
    carrier._send([(b"a packet", to)], _MEDIA_CLASS)
    assert (traffic_class(), traffic_class()) == (0xB8, 0x88)


def test_streams_reach_the_ports_that_their_sources_have(stack: ExitStack, pair: Pair) -> None:
    operator = pair.operator()
    pair.passes(operator, pair.robot, b"there")
    ends = {name: udp(stack) for name in ("rtp 7", "rtp 8", "rtcp 7", "rtcp 8")}
    ports = {name: port_of(end) for name, end in ends.items()}
    operator.follow(
        Routes(
            rtp={7: ports["rtp 7"], 8: ports["rtp 8"]},
            rtcp={7: ports["rtcp 7"], 8: ports["rtcp 8"]},
        )
    )
    source = streams_of(stack, pair.robot)
    pair.routed(operator)
    for number in range(50):
        for ssrc in (7, 8):
            for packet, name in ((rtp(number, ssrc), f"rtp {ssrc}"), (rtcp(ssrc), f"rtcp {ssrc}")):
                source.sendto(packet, (LOOPBACK, pair.robot.entrance_port))
                assert ends[name].recv(2000) == packet
    source.sendto(rtp(1, OTHERS_SSRC), (LOOPBACK, pair.robot.entrance_port))
    pair.until(lambda: operator.event.counts.get("of no stream") == 1)
    for end in ends.values():
        end.setblocking(False)
        with pytest.raises(BlockingIOError):
            end.recv(2000)


def test_feedback_goes_the_other_way_and_comes_from_the_port_to_which_streams_send(
    stack: ExitStack, pair: Pair
) -> None:
    """So that a stream can be connected to this one port, and takes packets of no other."""
    operator = pair.operator()
    pair.passes(operator, pair.robot, b"there")
    feedback, source = udp(stack), streams_of(stack, operator)
    pair.robot.follow(Routes(rtp={}, rtcp={7: port_of(feedback)}))
    pair.routed(operator)
    source.sendto(rtcp(7), (LOOPBACK, operator.entrance_port))
    assert feedback.recvfrom(2000) == (rtcp(7), (LOOPBACK, pair.robot.entrance_port))


def test_packets_of_another_program_of_this_computer_are_counted_and_not_sent(
    stack: ExitStack, pair: Pair
) -> None:
    """One with a far sequence number would void the next 500 of the encoder's."""
    operator = pair.operator()
    end, source, thief = udp(stack), streams_of(stack, pair.robot), udp(stack)
    operator.follow(Routes(rtp={7: port_of(end)}, rtcp={}))
    pair.routed(operator)
    entrance = (LOOPBACK, pair.robot.entrance_port)
    for number in range(1, 51):
        source.sendto(rtp(number), entrance)
        assert end.recv(2000) == rtp(number)
    thief.sendto(rtp(30_050), entrance)
    pair.until(lambda: pair.robot.event.counts.get("of another program") == 1)
    for number in range(51, 551):
        source.sendto(rtp(number), entrance)
        assert end.recv(2000) == rtp(number)


def test_a_packet_of_any_length_from_the_application_ends_nothing(
    stack: ExitStack, pair: Pair
) -> None:
    operator, source = pair.operator(), streams_of(stack, pair.robot)
    pair.routed(operator)
    for number, length in enumerate((0, 1, 11, 1170, 1171, 1500, 1501, 9000)):
        packet = (rtp(number, size=12) + bytes(length))[:length]
        source.sendto(packet, (LOOPBACK, pair.robot.entrance_port))
        pair.passes(pair.robot, operator, f"still here after {length}".encode())
    assert pair.robot.process.exit_code is None


def streams_of(stack: ExitStack, gateway: Gateway) -> socket.socket:
    """A socket of our own streams, from which the gateway takes packets."""
    source = udp(stack)
    gateway.follow(Routes(rtp={}, rtcp={OTHERS_SSRC + 1: port_of(source)}))
    return source


# --- who gets in ----------------------------------------------------------------------------------


@pytest.mark.parametrize("other", [True, False], ids=["another key", "none"])
def test_a_key_that_is_not_accepted_is_not_answered(
    stack: ExitStack, pair: Pair, tmp_path: Path, other: bool
) -> None:
    network = Network(stack, pair.robot.port)
    key = new_key(tmp_path / "other.key") if other else None
    stranger = pair.gateway("operator", network.port, key)
    ignored = "calls that no key made"
    pair.until(lambda: pair.robot.event.counts.get(ignored, 0) > 2, lambda: stranger.send(b"move"))
    assert all(map(is_call, network.recorded))
    assert not stranger.event.connected
    assert (pair.robot.event.connected, pair.heard[pair.robot]) == (False, [])
    pair.passes(pair.operator(), pair.robot, b"ours")


def test_of_a_folder_of_keys_each_gets_in_until_it_is_revoked(
    stack: ExitStack, tmp_path: Path
) -> None:
    folder = tmp_path / "keys"
    folder.mkdir()
    robot = Pair(stack, tmp_path, new_key(folder, "ann")).robot
    robot.close()
    pair = Pair(stack, tmp_path / "keys", folder)
    pair.key = folder / "ann.key"
    ann = pair.operator()
    pair.passes(ann, pair.robot, b"of ann")
    assert pair.robot.event.operator == "ann"
    copy = (folder / "ann.key").read_bytes()
    revoke_key(folder, "ann")
    pair.until(lambda: pair.robot.event.revoked and pair.robot.event.left)
    assert not pair.robot.event.connected
    pair.key = new_key(folder, "bo")  # while it runs
    pair.passes(pair.operator(), pair.robot, b"of bo")
    assert (pair.robot.event.operator, pair.robot.event.revoked) == ("bo", False)
    assert copy
    assert ann.event.sessions == 1


def test_a_second_operator_waits_until_the_first_says_goodbye(pair: Pair) -> None:
    first = pair.operator()
    pair.passes(first, pair.robot, b"first")
    second = pair.gateway("operator", pair.robot.port, pair.key)
    pair.until(lambda: second.event.busy, lambda: first.send(b"first"))
    first.close()
    del pair.heard[first]
    pair.until(lambda: pair.robot.event.left)
    pair.passes(second, pair.robot, b"second")
    assert not second.event.busy
    pair.until(lambda: pair.robot.event.sessions == 2)
    assert not pair.robot.event.left


def test_the_key_is_in_no_command_line_log_or_event(
    stack: ExitStack, pair: Pair, key: Path, tmp_path: Path
) -> None:
    operator = pair.operator()
    pair.passes(operator, pair.robot, b"up")
    new_key(tmp_path / "other.key")
    other = pair.gateway("operator", pair.robot.port, tmp_path / "other.key")
    pair.until(lambda: pair.robot.event.counts.get("calls that no key made", 0) > 0)
    told = [msgspec.json.encode(one.event) for one in (operator, pair.robot, other)]
    for gateway in (operator, pair.robot, other):
        for name in ("cmdline", "environ"):
            told.append(Path(f"/proc/{gateway.process.pid}/{name}").read_bytes())
        gateway.close()
    logs = list(tmp_path.rglob("*.log"))
    assert len(logs) == 3
    told += [path.read_bytes() for path in logs]
    robots = read_identity(key).private
    for secret in (read_key(key).secret, read_key(tmp_path / "other.key").secret, robots):
        forms = (secret, base64.b64encode(secret), secret.hex().encode(), repr(secret).encode())
        assert not any(form in text for form in forms for text in told)


@pytest.mark.parametrize(
    ("host", "port"),
    [("nowhere.invalid", 5000), ("a..b", 5000), (LOOPBACK, 65_536), ("203.0.113.1", 5000)],
)
def test_an_address_that_cannot_be_used_is_told_in_a_sentence(
    tmp_path: Path, host: str, port: int
) -> None:
    _refused("robot", Endpoint(host, port, None), tmp_path, f"{host}:{port} cannot be used")


def test_a_port_that_is_taken_is_told(pair: Pair, tmp_path: Path) -> None:
    taken = Endpoint(LOOPBACK, pair.robot.port, None)
    _refused("robot", taken, tmp_path, "cannot be used: Address already in use")


def test_a_key_that_others_can_read_is_refused(key: Path, tmp_path: Path) -> None:
    key.chmod(0o644)
    _refused("robot", Endpoint(LOOPBACK, 0, key), tmp_path, "chmod 600")


def _refused(side: str, endpoint: Endpoint, tmp_path: Path, sentence: str) -> None:
    gateway = Gateway(side, endpoint, b"", tmp_path)  # type: ignore[arg-type]
    gateway.launch()
    try:
        with pytest.raises(HelperError, match=sentence):
            gateway.wait_ready()
    finally:
        gateway.close()


# --- the end of one -------------------------------------------------------------------------------


@pytest.mark.parametrize("side", ["robot", "operator"])
def test_a_gateway_that_is_killed_is_noticed_and_raises_nothing(pair: Pair, side: str) -> None:
    operator = pair.operator()
    pair.passes(operator, pair.robot, b"there")
    victim = pair.robot if side == "robot" else operator
    assert victim.process.pid is not None
    os.kill(victim.process.pid, signal.SIGKILL)
    pair.until(lambda: victim.process.exit_code is not None)
    for _ in range(100):
        victim.send(b"x" * 1000)
        victim.follow(Routes({}, {}))
        victim.send_goodbye()
        victim.receive()
    assert victim.receive() == []


def test_an_application_without_room_hears_of_the_link_when_it_has(stack: ExitStack) -> None:
    ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    stack.callback(ours.close)
    for one in (ours, theirs):
        one.setblocking(False)
    outer = udp(stack)
    outer.setblocking(False)
    clock = VirtualClock()
    end = Door({LOOPBACK_KEY.identity: LOOPBACK_KEY}, shown(), b"", os.urandom)
    carrier = Carrier(end, outer, theirs, Streams(), None, clock)
    stack.callback(carrier.close)
    filling = 0
    with suppress(BlockingIOError):
        while filling < 10_000:
            theirs.send(bytes(1000))
            filling += 1

    def turn() -> None:
        clock.advance_ns(NS_PER_S)
        carrier.turn()

    end.counts["late"] += 1
    turn()
    for _ in range(filling):
        assert ours.recv(2000) == bytes(1000)
    turn()
    told = ours.recv(2000)
    assert msgspec.msgpack.decode(told, type=LinkEvent).counts == {"late": 1}
    turn()
    with pytest.raises(BlockingIOError):  # it is told once
        ours.recv(2000)


# --- strangers ------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    "datagrams",
    [5_000, pytest.param(1_000_000, marks=(pytest.mark.verify, pytest.mark.timeout(1800)))],
)
def test_hostile_datagrams_change_nothing(stack: ExitStack, pair: Pair, datagrams: int) -> None:
    network = Network(stack, pair.robot.port)
    operator = pair.operator(network.port)
    source = streams_of(stack, pair.robot)
    streams = {"rtp": udp(stack), "rtcp": udp(stack)}
    operator.follow(Routes({7: port_of(streams["rtp"])}, {7: port_of(streams["rtcp"])}))
    for number in range(30):
        pair.passes(operator, pair.robot, f"up {number}".encode())
        pair.passes(pair.robot, operator, f"down {number}".encode())
        for packet, end in ((rtp(number), streams["rtp"]), (rtcp(), streams["rtcp"])):
            source.sendto(packet, (LOOPBACK, pair.robot.entrance_port))
            assert end.recv(2000) == packet
    real = list(network.recorded)
    assert {is_long(datagram) for datagram in real} == {True, False}
    draw = random.Random(datagrams)
    for heard in pair.heard.values():
        heard.clear()
    sent: list[bytes] = []
    for number in range(datagrams):
        datagram = hostile(number, real, draw)
        if number % 8 == 7:
            network.to_operator(datagram)
        elif number % 2:
            network.to_robot(datagram)
        else:
            source.sendto(datagram, (LOOPBACK, pair.robot.port))
        if number % BATCH == BATCH - 1:
            message = f"message {number}".encode()
            sent.append(message)
            pair.passes(operator, pair.robot, message)
            pair.passes(pair.robot, operator, message)
    for gateway in (operator, pair.robot):
        heard = pair.heard[gateway]
        assert [m for n, m in enumerate(heard) if m not in heard[:n]] == sent
        assert gateway.process.exit_code is None
        assert gateway.event.sessions == 1
    pair.until(lambda: sum(pair.robot.event.counts.values()) > datagrams // 2)
    pair.until(lambda: sum(operator.event.counts.values()) > datagrams // 20)
    for end in streams.values():
        end.setblocking(False)
        with pytest.raises(BlockingIOError):
            end.recv(2000)
