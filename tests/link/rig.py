"""Both ends of the link in this process: virtual time, and a network that the test decides on."""

from __future__ import annotations

import os
import random
import struct
from collections.abc import Callable, Sequence
from functools import cache

from tams_app.link.addresses import Address
from tams_app.link.caller import Caller
from tams_app.link.certificate import Leaf, leaf
from tams_app.link.channel import LET_GO_NS, LINK, Channel, Heard
from tams_app.link.door import Door
from tams_app.link.identity import RobotIdentity
from tams_app.link.keys import Key
from tams_app.link.quic import LONG_HEADER, LONGEST_DATAGRAM_BYTES
from tams_app.units import NS_PER_MS

IDENTITY = RobotIdentity(b"i" * 32)
KEY = Key("kim", b"k" * 32, IDENTITY.public)
OTHER_KEY = Key("kay", b"k" * 31 + b"l", IDENTITY.public)
INITIALS, SHORT = range(0xC0, 0xD0), range(0x40, 0x80)  # first bytes (RFC 9000, 17)
KINDS = (*INITIALS, 0xE3, 0xF0, 0xC5, *SHORT, 0x80, 0xBF)
ROBOT: Address = ("10.0.0.1", 5000)
DESK: Address = ("10.0.0.2", 40_000)
THIEF: Address = ("203.0.113.9", 666)
LET_GO_MS = LET_GO_NS / NS_PER_MS
STEP_NS = 10 * NS_PER_MS
UNIX_S = 1_800_000_000.0

Deliver = Callable[[bytes], bool]


def everything(_: bytes) -> bool:
    """A network that loses nothing."""
    return True


def nothing(_: bytes) -> bool:
    """A network that is cut."""
    return False


def rtp(sequence: int = 1, ssrc: int = 7, size: int = 40) -> bytes:
    """An RTP packet with an empty payload of `size` bytes, header included."""
    head = struct.pack("!BBHII", 0x80, 96, sequence & 0xFFFF, 3000 * sequence, ssrc)
    return head + bytes(size - len(head))


def rtcp(ssrc: int = 7) -> bytes:
    """An RTCP receiver report with one block."""
    return struct.pack("!BBHI", 0x81, 201, 7, ssrc) + bytes(24)


def is_long(datagram: bytes) -> bool:
    """Whether it belongs to a handshake."""
    return bool(datagram) and datagram[0] >= LONG_HEADER


def is_call(datagram: bytes) -> bool:
    """Whether it is of a caller who is not known yet, or may be."""
    return len(datagram) == LONGEST_DATAGRAM_BYTES and datagram[0] in INITIALS


def is_retry(datagram: bytes) -> bool:
    """Whether it asks a caller to show that they receive where they call from."""
    return bool(datagram) and datagram[0] & 0xF0 == 0xF0


def datagram_of(sent: list[tuple[bytes, Address]]) -> bytes:
    """What an end sends, which has a session to send it in."""
    (addressed,) = sent
    return addressed[0]


def flipped(datagram: bytes, step: int = 1) -> list[bytes]:
    """Copies of it with one bit changed, every `step`-th."""
    whole, bits = int.from_bytes(datagram, "big"), range(0, 8 * len(datagram), step)
    return [(whole ^ 1 << bit).to_bytes(len(datagram), "big") for bit in bits]


def spoilt(datagram: bytes, draw: random.Random) -> bytes:
    """A copy that is not what it was: bits flipped, cut short, made longer, or of another kind."""
    changed = bytearray(datagram)
    match draw.randrange(4):
        case 0:
            for _ in range(draw.randint(1, 3)):
                changed[draw.randrange(len(changed))] ^= 1 << draw.randrange(8)
        case 1:
            del changed[draw.randrange(len(changed)) :]
        case 2:
            changed += draw.randbytes(draw.randint(1, 40))
        case _:
            at = draw.randrange(min(1, len(changed) - 1), len(changed))  # its kind stays
            changed[at:] = draw.randbytes(len(changed) - at)
    return datagram[:-1] if changed == datagram else bytes(changed)


def hostile(number: int, real: Sequence[bytes], draw: random.Random) -> bytes:
    """Noise, noise that begins as ours does, copies that were changed, and recordings."""
    match number % 5:
        case 0:
            return draw.randbytes(draw.randrange(1500))
        case 1:
            first = draw.choice(KINDS)
            return bytes((first,)) + draw.randbytes(draw.randrange(120))
        case 2:
            return spoilt(draw.choice(real), draw)
        case 3:
            whole = draw.choice(real)
            return whole[: draw.randrange(len(whole))]
        case _:
            return draw.choice(real)


class Desk:
    """An operator's end, where it is in the network, and all that it has sent."""

    def __init__(
        self,
        key: Key = KEY,
        address: Address = DESK,
        introduction: bytes = b"",
    ) -> None:
        self.end = Caller(key, [ROBOT], os.urandom, introduction)
        self.address = address
        self.sent: list[bytes] = []
        self.came: list[bytes] = []  # from the robot's side
        self.heard: list[bytes] = []
        self.media: list[bytes] = []
        self.sessions = 0

    @property
    def calls(self) -> int:
        """Datagrams with which it has called."""
        return sum(map(is_call, self.sent))


@cache
def shown(identity: RobotIdentity = IDENTITY) -> Leaf:
    """A certificate of this robot."""
    return leaf(identity, UNIX_S)


def robot(*keys: Key) -> Door:
    """The robot's end as it starts; it accepts these keys, or `KEY`."""
    return Door({key.identity: key for key in keys or (KEY,)}, shown(), b"welcome", os.urandom)


class Rig:
    """The robot's end and the network; operators' ends are given to each call."""

    def __init__(self, end: Door | None = None) -> None:
        self.robot = robot() if end is None else end
        self.now_ns = 1_000_000_000_000
        self.up: Deliver = everything  # from an operator's end to the robot's
        self.down: Deliver = everything
        self.heard: list[bytes] = []
        self.media: list[bytes] = []
        self.sessions = 0
        self.departures = 0
        self.answers: list[tuple[bytes, Address]] = []  # all that the robot's end has sent
        self._desks: dict[Address, Desk] = {}
        self._probes = 0

    def at_robot(self, datagram: bytes, address: Address) -> Heard:
        """A datagram reaches the robot's port; what it answers is not delivered."""
        heard = self.robot.receive(datagram, address, self.now_ns)
        self.sessions += heard.connected
        self.departures += heard.left
        self.heard += heard.messages
        self.media += heard.media
        return heard

    def at_desk(self, desk: Desk, datagram: bytes) -> Heard:
        """A datagram reaches an operator's port; replies go back at once."""
        desk.came.append(datagram)
        heard = desk.end.receive(datagram, ROBOT, self.now_ns)
        desk.sessions += heard.connected
        desk.heard += heard.messages
        desk.media += heard.media
        self.send_up(desk, heard.replies)
        return heard

    def send_up(self, desk: Desk, datagrams: Sequence[tuple[bytes, Address]]) -> None:
        """An operator's end sends; replies come back at once."""
        self._desks[desk.address] = desk
        for datagram, to in datagrams:
            assert to == ROBOT
            desk.sent.append(datagram)
            if self.up(datagram):
                self.send_down(self.at_robot(datagram, desk.address).replies)

    def send_down(self, datagrams: Sequence[tuple[bytes, Address]]) -> None:
        """The robot's end sends."""
        for datagram, to in datagrams:
            self.answers.append((datagram, to))
            if to in self._desks and self.down(datagram):
                self.at_desk(self._desks[to], datagram)

    def say(self, desk: Desk, content: bytes) -> None:
        """The operator's application sends a message, if there is a session."""
        self.send_up(desk, desk.end.message(content, self.now_ns))

    def tell(self, content: bytes) -> int:
        """The robot's application sends a message; in how many datagrams."""
        sent = self.robot.message(content, self.now_ns)
        self.send_down(sent)
        return len(sent)

    def step(self, *desks: Desk) -> None:
        """Ten milliseconds: each end does what is due, and both sides send one message."""
        self.now_ns += STEP_NS
        for desk in desks:
            self.send_up(desk, desk.end.step(self.now_ns))
            self.say(desk, b"hand")
        self.send_down(self.robot.step(self.now_ns))
        self.tell(b"state")

    def run_ms(self, duration_ms: float, *desks: Desk) -> None:
        """Let time pass."""
        for _ in range(round(duration_ms * NS_PER_MS / STEP_NS)):
            self.step(*desks)

    def gets_through(self, desk: Desk) -> bool:
        """Whether the next message of the operator reaches the robot, and the next one them."""
        self._probes += 1
        probe = f"probe {self._probes}".encode()
        self.say(desk, probe)
        self.tell(probe)
        return self.heard[-1:] == desk.heard[-1:] == [probe]


def channel_of(end: Door | Caller) -> Channel:
    """The connection that an end has a session in."""
    assert end._channel is not None
    return end._channel


def link_message(end: Door | Caller, content: bytes, now_ns: int) -> bytes:
    """The datagram of a message of the link itself."""
    return datagram_of(end.message(content, now_ns, LINK))


def connected() -> tuple[Rig, Desk]:
    """A rig with one operator, who is connected."""
    rig, desk = Rig(), Desk()
    rig.run_ms(50, desk)
    assert rig.gets_through(desk)
    return rig, desk
