"""What both ends of the link do: messages and media over one QUIC connection.

Each message fills one of a few sizes, so that a length tells nothing of what is said, and has a
number: one that is no newer than the newest is late, and is refused. A packet of media is as it
is. A datagram is sent in the moment in which it is handed over, so that nothing waits for another.
"""

from __future__ import annotations

import struct
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field

from tams_app.link.addresses import Address
from tams_app.link.proof import WordStream
from tams_app.link.quic import LONGEST_CONTENT_BYTES, OVERHEAD_BYTES, Came, Connection
from tams_app.units import NS_PER_S

# Packets of media begin with 128 to 191 (RFC 7983); messages with their kind:
MESSAGE, LINK = 1, 2  # of the applications, and of the link itself
MEDIA = range(128, 192)
# Messages of the link itself:
GOODBYE = b"goodbye"
QUESTION, REPLY = b"where", b"here!"  # and a token: is the operator there?
PING, PONG = b"ping", b"pong"  # and anything, which comes back

LET_GO_NS = 3 * NS_PER_S  # an operator who is not heard for so long has let go
RENEW_NS = 300 * NS_PER_S  # how often keys are replaced
OVERLAP_NS = 5 * NS_PER_S  # what old keys sealed is taken for so long
OUTWORN_NS = 600 * NS_PER_S  # keys that are older are not used

_HEAD = struct.Struct("!BIH")  # kind, number, length
LONGEST_MESSAGE_BYTES = LONGEST_CONTENT_BYTES - _HEAD.size
# What a message is filled up to:
LINK_BYTES = 64  # messages of the link itself
HAND_BYTES = 256  # a sample of the hand
STATE_BYTES = 512  # a state of the robot with its longest reason
_SIZES = (LINK_BYTES, HAND_BYTES, STATE_BYTES, LONGEST_MESSAGE_BYTES)
_SHORTEST_MEDIA_BYTES = 8
_RTCP = range(192, 224)


def message_bytes(content_bytes: int, least_bytes: int = LINK_BYTES) -> int:
    """UDP payload of a message with so many bytes, filled up to `least_bytes`."""
    whole = max(content_bytes, least_bytes)
    size = next((size for size in _SIZES if size >= whole), whole)
    return OVERHEAD_BYTES + _HEAD.size + size


def is_rtcp(packet: bytes) -> bool:
    """Whether it is RTCP where both share a port (RFC 5761, 4)."""
    return len(packet) > 1 and packet[1] in _RTCP


def ssrc_of(packet: bytes) -> int:
    """The stream that an RTP packet is of, or an RTCP packet's sender; 0 if it is too short."""
    return int.from_bytes(packet[4:8] if is_rtcp(packet) else packet[8:12])


def is_media(content: bytes) -> bool:
    """Whether it is a whole packet of RTP or RTCP."""
    return len(content) >= _SHORTEST_MEDIA_BYTES and content[0] in MEDIA


@dataclass(slots=True)
class Heard:
    """What became of one datagram."""

    replies: list[tuple[bytes, Address]] = field(default_factory=list)
    messages: list[bytes] = field(default_factory=list)
    media: list[bytes] = field(default_factory=list)
    echoes: list[bytes] = field(default_factory=list)  # what followed a ping of ours
    connected: bool = False  # a new session with an operator has begun with this datagram
    left: bool = False  # the other side has said goodbye, or its key is accepted no longer


class Channel:
    """A connection with the other side. `address`: where that is; `heard_ns`: when it was heard."""

    def __init__(
        self, connection: Connection, address: Address, least_bytes: int, now_ns: int
    ) -> None:
        """`least_bytes`: what messages of the application are filled up to."""
        self.connection, self.address = connection, address
        self.began_ns = self.heard_ns = self.renewed_ns = now_ns
        self.words = WordStream()
        self._least_bytes = least_bytes
        self._renewals = 0
        self._sent = self._newest = 0

    def message(self, content: bytes, kind: int = MESSAGE) -> bool:
        """Put a message; False if it is too long."""
        if len(content) > LONGEST_MESSAGE_BYTES:
            return False
        self._sent += 1
        least_bytes = self._least_bytes if kind == MESSAGE else LINK_BYTES
        head = _HEAD.pack(kind, self._sent, len(content))
        return self.connection.put(
            (head + content).ljust(message_bytes(len(content), least_bytes) - OVERHEAD_BYTES, b"\0")
        )

    def media(self, packet: bytes) -> bool:
        """Put a packet of media; False if it is none, or too long."""
        return is_media(packet) and self.connection.put(packet)

    def datagrams(self, now_ns: int) -> list[tuple[bytes, Address]]:
        """What was put, and what QUIC has to send now."""
        return [(one, self.address) for one in self.connection.datagrams(now_ns)]

    def receive(self, datagram: bytes, now_ns: int) -> Came:
        """Take a datagram in."""
        came = self.connection.receive(datagram, now_ns)
        if self.connection.renewals > self._renewals:
            self._renewals, self.renewed_ns = self.connection.renewals, now_ns
        elif now_ns - self.renewed_ns >= OVERLAP_NS:
            self.connection.forget_old_keys()
        return came

    def open(self, content: bytes, now_ns: int) -> tuple[int, bytes] | str:
        """Kind and content of a datagram, MEDIA's first kind for a packet; or why it is refused."""
        if is_media(content):
            self.heard_ns = now_ns
            return MEDIA.start, content
        if len(content) < _HEAD.size:
            return "of no known kind"
        kind, number, length = _HEAD.unpack_from(content)
        if kind not in (MESSAGE, LINK) or length > len(content) - _HEAD.size:
            return "of no known kind"
        if number <= self._newest:
            return "late"
        self._newest, self.heard_ns = number, now_ns
        return kind, content[_HEAD.size : _HEAD.size + length]

    def is_outworn(self, now_ns: int) -> bool:
        """Whether its keys are too old."""
        return self.connection.ended or now_ns - self.renewed_ns >= OUTWORN_NS


class End:
    """What both ends do."""

    def __init__(self, random: Callable[[int], bytes]) -> None:
        """`random`: so many random bytes."""
        self.counts: Counter[str] = Counter()  # datagrams that changed nothing, by reason
        self._random = random
        self._channel: Channel | None = None
        self._routes: dict[bytes, Channel] = {}

    @property
    def connected(self) -> bool:
        """Whether there is a session; the other side may be silent all the same."""
        return self._channel is not None

    @property
    def address(self) -> Address:
        """Where the other side is, or was."""
        return ("", 0) if self._channel is None else self._channel.address

    @property
    def renewals(self) -> int:
        """How often the keys of the session that there is were replaced."""
        return 0 if self._channel is None else self._channel.connection.renewals

    def silent_ns(self, now_ns: int) -> int | None:
        """Since when nothing was heard; None without a session."""
        return None if self._channel is None else now_ns - self._channel.heard_ns

    def message(
        self, content: bytes, now_ns: int, kind: int = MESSAGE
    ) -> list[tuple[bytes, Address]]:
        """The datagram that carries a message, and where to; nothing if none may be sent."""
        channel = self._may_send(now_ns)
        if channel is None:
            return []
        if not channel.message(content, kind):
            self.counts["too long to be sent"] += 1
        return channel.datagrams(now_ns)

    def goodbye(self, now_ns: int) -> list[tuple[bytes, Address]]:
        """This side leaves, which the other one is to know."""
        return self.message(GOODBYE, now_ns, LINK)

    def media(self, packet: bytes, now_ns: int) -> list[tuple[bytes, Address]]:
        """The datagram of an RTP or RTCP packet, and where to; nothing if it is neither, or no."""
        channel = self._may_send(now_ns)
        if channel is None:
            return []
        if not channel.media(packet):
            self.counts["no packet that can be sent"] += 1
        return channel.datagrams(now_ns)

    def due_ns(self, now_ns: int) -> int | None:
        """When `step` is to be called at the latest; None: at no certain time."""
        times = [one.connection.due_ns() for one in self._active(now_ns)]
        return min((one for one in times if one is not None), default=None)

    def _active(self, now_ns: int) -> Iterator[Channel]:
        """The connections in which something may be sent."""
        channel = self._may_send(now_ns)
        if channel is not None:
            yield channel

    def _timed(self, now_ns: int) -> list[tuple[bytes, Address]]:
        """What QUIC has to send now without being asked."""
        sent: list[tuple[bytes, Address]] = []
        for channel in list(self._active(now_ns)):
            due_ns = channel.connection.due_ns()
            if due_ns is not None and due_ns <= now_ns:
                sent += channel.datagrams(now_ns)
        return sent

    def _may_send(self, now_ns: int) -> Channel | None:
        self._wear_out(now_ns)
        return self._channel

    def _wear_out(self, now_ns: int) -> None:
        """Without new keys for so long there is no session any more."""
        if self._channel is not None and self._channel.is_outworn(now_ns):
            self._drop(self._channel)

    def _drop(self, channel: Channel) -> None:
        """Forget a connection, without a word."""
        if channel is self._channel:
            self._channel = None
        for name in [name for name, one in self._routes.items() if one is channel]:
            del self._routes[name]

    def _received(self, channel: Channel, datagram: bytes, now_ns: int) -> Came:
        """Take in a packet of this connection; counts what changes nothing."""
        came = channel.receive(datagram, now_ns)
        self.counts += channel.connection.counts
        channel.connection.counts.clear()
        for name in came.issued:
            self._routes[name] = channel
        for name in came.retired:
            self._routes.pop(name, None)
        return came

    def _said(self, channel: Channel, came: Came, address: Address, now_ns: int) -> Heard:
        """What the other side says in the session that there is."""
        heard = Heard()
        if channel.is_outworn(now_ns):
            heard.left = channel.connection.ended
            self._drop(channel)
            return heard
        for content in came.contents:
            opened = channel.open(content, now_ns)
            if isinstance(opened, str):
                self.counts[opened] += 1
                continue
            kind, said = opened
            if kind in MEDIA:
                heard.media.append(said)
            elif kind == MESSAGE:
                heard.messages.append(said)
            elif said == GOODBYE:
                heard.left = True
                self._drop(channel)
                return heard
            elif said.startswith(PING):
                heard.replies += self.message(PONG + said.removeprefix(PING), now_ns, LINK)
            elif said.startswith(PONG):
                heard.echoes.append(said.removeprefix(PONG))
            else:
                self._link_said(heard, channel, said, address, now_ns)
        return heard

    def _link_said(
        self, heard: Heard, channel: Channel, said: bytes, address: Address, now_ns: int
    ) -> None:
        """A message of the link that only one of the two ends knows."""
        self.counts["of no known kind"] += 1
