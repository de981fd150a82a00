"""Both ends of the link in this process: virtual time, and a network that the test decides on."""

from __future__ import annotations

import random
import struct
from collections.abc import Callable, Sequence
from itertools import count

from tams_app.link.addresses import Address
from tams_app.link.ends import LET_GO_NS, Heard, RobotEnd
from tams_app.link.handshake import BUSY, COOKIE, INITIATION, RESPONSE
from tams_app.link.keys import Key
from tams_app.link.operator_end import OperatorEnd
from tams_app.link.peer import MESSAGE
from tams_app.units import NS_PER_MS

KEY, OTHER_KEY = Key("kim", b"k" * 32), Key("kay", b"k" * 31 + b"l")
KINDS = (INITIATION, COOKIE, BUSY, RESPONSE, MESSAGE, 0x80, 0x81, 0xBF)
ROBOT: Address = ("10.0.0.1", 5000)
DESK: Address = ("10.0.0.2", 40_000)
THIEF: Address = ("203.0.113.9", 666)
LET_GO_MS = LET_GO_NS / NS_PER_MS
STEP_NS = 10 * NS_PER_MS

_RUNS = count()  # each robot's end draws numbers of its own

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


def datagram_of(addressed: tuple[bytes, Address] | None) -> bytes:
    """What an end sends, which has a session to send it in."""
    assert addressed is not None
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
        seed: int = 0,
        introduction: bytes = b"",
    ) -> None:
        self.end = OperatorEnd(key, [ROBOT], random.Random(seed).randbytes, introduction)
        self.address = address
        self.sent: list[bytes] = []
        self.heard: list[bytes] = []
        self.media: list[bytes] = []
        self.calls = 0
        self.sessions = 0


def robot(*keys: Key) -> RobotEnd:
    """The robot's end as it starts; it accepts these keys, or `KEY`."""
    draw = random.Random(next(_RUNS)).randbytes
    return RobotEnd({key.identity: key for key in keys or (KEY,)}, b"welcome", draw)


class Rig:
    """The robot's end and the network; operators' ends are given to each call."""

    def __init__(self) -> None:
        self.robot = robot()
        self.now_ns = 1_000_000_000_000
        self.up: Deliver = everything  # from an operator's end to the robot's
        self.down: Deliver = everything
        self.heard: list[bytes] = []
        self.media: list[bytes] = []
        self.sessions = 0
        self.departures = 0
        self.answers: list[bytes] = []
        self._probes = 0

    def at_robot(self, datagram: bytes, address: Address) -> Heard:
        """A datagram reaches the robot's port."""
        heard = self.robot.receive(datagram, address, self.now_ns)
        self.sessions += heard.connected
        self.departures += heard.left
        if heard.message is not None:
            self.heard.append(heard.message)
        if heard.media is not None:
            self.media.append(heard.media)
        return heard

    def at_desk(self, desk: Desk, datagram: bytes) -> Heard:
        """A datagram reaches an operator's port."""
        heard = desk.end.receive(datagram, ROBOT, self.now_ns)
        desk.sessions += heard.connected
        if heard.message is not None:
            desk.heard.append(heard.message)
        if heard.media is not None:
            desk.media.append(heard.media)
        for reply, to in heard.replies:
            assert to == ROBOT
            self.send_up(desk, reply)
        return heard

    def send_up(self, desk: Desk, datagram: bytes) -> None:
        """An operator's end sends; replies come back at once."""
        desk.sent.append(datagram)
        if not self.up(datagram):
            return
        for reply, to in self.at_robot(datagram, desk.address).replies:
            self.answers.append(reply)
            if to != desk.address:
                continue
            if self.down(reply):
                self.at_desk(desk, reply)

    def say(self, desk: Desk, content: bytes) -> None:
        """The operator's application sends a message, if there is a session."""
        addressed = desk.end.message(content, self.now_ns)
        if addressed is not None:
            assert addressed[1] == ROBOT
            self.send_up(desk, addressed[0])

    def tell(self, desk: Desk, content: bytes) -> bool:
        """The robot's application sends a message; whether it was sent to this operator."""
        addressed = self.robot.message(content, self.now_ns)
        if addressed is None or addressed[1] != desk.address:
            return False
        if self.down(addressed[0]):
            self.at_desk(desk, addressed[0])
        return True

    def step(self, *desks: Desk) -> None:
        """Ten milliseconds: each end calls if it must, and both sides send one message."""
        self.now_ns += STEP_NS
        for desk in desks:
            for datagram, _ in desk.end.step(self.now_ns):
                desk.calls += datagram[0] == INITIATION
                self.send_up(desk, datagram)
            self.say(desk, b"hand")
            self.tell(desk, b"state")

    def run_ms(self, duration_ms: float, *desks: Desk) -> None:
        """Let time pass."""
        for _ in range(round(duration_ms * NS_PER_MS / STEP_NS)):
            self.step(*desks)

    def gets_through(self, desk: Desk) -> bool:
        """Whether the next message of the operator reaches the robot, and the next one them."""
        self._probes += 1
        probe = f"probe {self._probes}".encode()
        self.say(desk, probe)
        self.tell(desk, probe)
        return self.heard[-1:] == desk.heard[-1:] == [probe]


def connected() -> tuple[Rig, Desk]:
    """A rig with one operator, who is connected."""
    rig, desk = Rig(), Desk()
    rig.run_ms(50, desk)
    assert rig.gets_through(desk)
    return rig, desk
