"""What each end of the link does with a datagram: pure, with times and addresses as arguments.

One UDP port carries everything; the first byte tells what a datagram is (as RFC 7983 has it: 128 to
191 are RTP and RTCP; ours are above). A datagram that the other side's key did not make changes
nothing but a counter.

`RobotEnd` waits to be called. A caller becomes the operator with the first message under the keys
of its own call, so that a recorded call, sent again, is answered and nothing more. There is one
operator at a time: while one is heard, or was a moment ago, others are told that it is busy.
`OperatorEnd` calls until it is answered, and calls again when nothing is heard any more, or when it
hears the robot's side again after a long time.
"""

from __future__ import annotations

from collections import Counter, OrderedDict
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import TypeAlias

from tams_app.link.handshake import Answerer, Dialer, HandshakeError, SessionKeys
from tams_app.link.sealing import Media, MessageOpener, MessageSealer
from tams_app.units import NS_PER_MS, NS_PER_S

Address: TypeAlias = tuple[str, int] | tuple[str, int, int, int]  # of IPv4, of IPv6

HELLO, ANSWER, MESSAGE, REFUSAL = 0xC1, 0xC2, 0xC3, 0xC4
TAG_BYTES = 8  # of a call, chosen by the caller: tells which call an answer is to
_MEDIA = range(128, 192)
GOODBYE = b"\0goodbye"  # beside messages of the applications, which begin otherwise
BUSY, WELCOME = b"\1", b"\0"  # the first byte of an answer's content

LET_GO_NS = 3 * NS_PER_S  # an operator who is not heard for so long has let go
REDIAL_NS = 2 * NS_PER_S  # not heard for so long: call again
# Not heard for so long: what is heard then begins a session anew. SRTP's packet index is lost after
# 32,768 packets that did not arrive (RFC 3711, 3.3.1); a view sends at most some 1,000 a second.
_OUTLIVED_NS = 30 * NS_PER_S
_RING_NS = 250 * NS_PER_MS  # between two calls
_ATTEMPT_NS = 5 * NS_PER_S  # a call that is not answered is begun anew, with other keys
# A flood must not take the time of the operator who is there: a call is looked at in .1 ms.
_CALLS_PER_S = 500
_CALLS_KEPT = 4
_ANSWERS_TO_A_CALL = 40  # of an attempt's ring each; a recorded one is not worth reflecting
_CALL_KEPT_NS = 2 * _ATTEMPT_NS  # what was recorded of a call that came to nothing is void then


@dataclass(slots=True)
class Heard:
    """What became of one datagram."""

    replies: list[tuple[bytes, Address]] = field(default_factory=list)
    message: bytes | None = None
    media: bytes | None = None
    connected: bool = False  # a new session has begun with this datagram
    left: bool = False  # the other side has said goodbye


class _Peer:
    """The other side, under the keys of one session."""

    def __init__(self, keys: SessionKeys) -> None:
        self.media = Media(keys)
        self._sealer = MessageSealer(keys.send.messages, MESSAGE)
        self._opener = MessageOpener(keys.receive.messages)
        self.address: Address = ("", 0)
        self.heard_ns = 0

    @property
    def late(self) -> int:
        """Messages that were repeated or overtaken."""
        return self._opener.late

    def seal(self, message: bytes) -> bytes:
        return self._sealer.seal(message)

    def open(self, datagram: bytes) -> bytes | None:
        return self._opener.open(datagram)


@dataclass(slots=True)
class _Call:
    """A call that was answered, and not confirmed yet."""

    hello: bytes
    answer: bytes
    peer: _Peer
    answered_ns: int  # the first time
    answers: int = 1


class _End:
    """What both ends do."""

    def __init__(self) -> None:
        self.counts: Counter[str] = Counter()  # datagrams that changed nothing, by reason
        self._peer: _Peer | None = None

    @property
    def connected(self) -> bool:
        """Whether there is a session; the other side may be silent all the same."""
        return self._peer is not None

    def silent_ns(self, now_ns: int) -> int | None:
        """Since when nothing was heard; None without a session."""
        return None if self._peer is None else now_ns - self._peer.heard_ns

    def message(self, content: bytes) -> tuple[bytes, Address] | None:
        """The datagram that carries a message, and where to; None without a session."""
        peer = self._peer
        return None if peer is None else (peer.seal(content), peer.address)

    def media(self, packet: bytes) -> tuple[bytes, Address] | None:
        """The datagram of an RTP or RTCP packet, and where to; None if it is neither."""
        peer = self._peer
        protected = None if peer is None else peer.media.protect(packet)
        return None if peer is None or protected is None else (protected, peer.address)

    def _take(self, datagram: bytes, address: Address, now_ns: int) -> Heard:
        """A message or a packet of the session that there is."""
        heard, peer = Heard(), self._peer
        if peer is None:
            return self._refuse(heard, "without a session")
        if datagram[0] == MESSAGE:
            before = peer.late
            heard.message = peer.open(datagram)
            if heard.message is None:
                return self._refuse(heard, "late" if peer.late > before else "not authentic")
            peer.address = address  # a newer message from elsewhere: the other side has moved
        else:
            heard.media = peer.media.unprotect(datagram)
            if heard.media is None:
                return self._refuse(heard, "media not authentic")
        peer.heard_ns = now_ns
        if heard.message == GOODBYE:
            heard.message, heard.left = None, True
            self._peer = None
        return heard

    def _refuse(self, heard: Heard, reason: str) -> Heard:
        self.counts[reason] += 1
        return heard


class RobotEnd(_End):
    """The end that waits for an operator."""

    def __init__(self, key: bytes, welcome: bytes) -> None:
        """`welcome`: what an operator is told when they connect."""
        super().__init__()
        self._key = key
        self._welcome = welcome
        self._calls: OrderedDict[bytes, _Call] = OrderedDict()
        self._second = -1
        self._calls_this_second = 0

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> Heard:
        """Take one datagram in."""
        kind = datagram[0] if datagram else 0
        if kind == HELLO:
            return self._called(datagram, address, now_ns)
        if kind == MESSAGE and (heard := self._confirmed(datagram, address, now_ns)):
            return heard
        if kind == MESSAGE or kind in _MEDIA:
            return self._take(datagram, address, now_ns)
        return self._refuse(Heard(), "of no known kind")

    def _called(self, datagram: bytes, address: Address, now_ns: int) -> Heard:
        heard = Heard()
        tag, hello = datagram[1 : 1 + TAG_BYTES], datagram[1 + TAG_BYTES :]
        self._forget_calls(now_ns)
        call = self._calls.get(tag)
        if call is not None and call.hello == hello:  # the answer was lost, or it comes again
            call.answers += 1
            if call.answers > _ANSWERS_TO_A_CALL:
                return self._refuse(heard, "calls that were answered")
            heard.replies.append((call.answer, address))
            return heard
        if not self._has_time_for_a_call(now_ns):
            return self._refuse(heard, "calls beyond what is looked at")
        try:
            caller = Answerer(self._key, hello)
        except HandshakeError:
            heard.replies.append((bytes((REFUSAL,)) + tag, address))
            return self._refuse(heard, "calls with another key")
        silent_ns = self.silent_ns(now_ns)
        busy = silent_ns is not None and silent_ns < LET_GO_NS
        content, keys = caller.answer(BUSY if busy else WELCOME + self._welcome)
        answer = bytes((ANSWER,)) + tag + content
        if not busy:  # one that is busy now may not be when the same caller calls anew
            self._calls[tag] = _Call(hello, answer, _Peer(keys), now_ns)
            while len(self._calls) > _CALLS_KEPT:
                self._calls.popitem(last=False)
        heard.replies.append((answer, address))
        return heard

    def _forget_calls(self, now_ns: int) -> None:
        for tag, call in list(self._calls.items()):
            if now_ns - call.answered_ns > _CALL_KEPT_NS:
                del self._calls[tag]

    def _has_time_for_a_call(self, now_ns: int) -> bool:
        second = now_ns // NS_PER_S
        if second != self._second:
            self._second, self._calls_this_second = second, 0
        self._calls_this_second += 1
        return self._calls_this_second <= _CALLS_PER_S

    def _confirmed(self, datagram: bytes, address: Address, now_ns: int) -> Heard | None:
        """The first message of a call: the caller is who they say, now. None if it is not one."""
        silent_ns = self.silent_ns(now_ns)
        if silent_ns is not None and silent_ns < LET_GO_NS:
            return None
        self._forget_calls(now_ns)
        for tag, call in self._calls.items():
            message = call.peer.open(datagram)
            if message is None:
                continue
            del self._calls[tag]
            if message == GOODBYE:  # of a caller who has not become the operator
                return Heard()
            self._peer = call.peer
            self._peer.address, self._peer.heard_ns = address, now_ns
            return Heard(message=message, connected=True)
        return None


class OperatorEnd(_End):
    """The end that calls."""

    def __init__(
        self, key: bytes, robot: Address, greeting: bytes, random: Callable[[int], bytes]
    ) -> None:
        """`greeting`: what the robot's side is told. `random`: so many random bytes."""
        super().__init__()
        self.welcome: bytes | None = None  # what the robot's side said last
        self.busy = False  # the robot's side has another operator
        self.refused = False  # something answers there, but does not hold our key
        self._key, self._robot, self._greeting, self._random = key, robot, greeting, random
        self._dialer: Dialer | None = None
        self._tag = b""
        self._began_ns = self._rang_ns = -_ATTEMPT_NS

    def step(self, now_ns: int) -> list[tuple[bytes, Address]]:
        """Calls that are to be sent now."""
        silent_ns = self.silent_ns(now_ns)
        if silent_ns is not None and silent_ns < REDIAL_NS:
            self._dialer = None
            return []
        if now_ns - self._rang_ns < _RING_NS:  # also after an answer that came to nothing
            return []
        if self._dialer is None or now_ns - self._began_ns >= _ATTEMPT_NS:
            self._dialer = Dialer(self._key, self._greeting)
            self._tag = self._random(TAG_BYTES)
            self._began_ns = now_ns
        self._rang_ns = now_ns
        return [(bytes((HELLO,)) + self._tag + self._dialer.hello, self._robot)]

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> Heard:
        """Take one datagram in."""
        kind = datagram[0] if datagram else 0
        if kind == ANSWER:
            return self._answered(datagram, address, now_ns)
        if kind == REFUSAL and datagram[1:] == self._tag:  # not authentic: for people to read
            self.refused = not self.connected
            return Heard()
        if kind == MESSAGE or kind in _MEDIA:
            silent_ns = self.silent_ns(now_ns)
            heard = self._take(datagram, address, now_ns)
            if heard.message is None and heard.media is None:
                return heard
            self.busy = False  # said while it heard us, and we did not hear it
            if silent_ns is not None and silent_ns >= _OUTLIVED_NS:
                heard = self._hang_up()
            return heard
        return self._refuse(Heard(), "of no known kind")

    def _hang_up(self) -> Heard:
        """Tell the other side, which is then free for the next call."""
        goodbye = self.message(GOODBYE)
        self._peer = self._dialer = None
        return Heard(replies=[] if goodbye is None else [goodbye])

    def _answered(self, datagram: bytes, address: Address, now_ns: int) -> Heard:
        heard = Heard()
        tag, content = datagram[1 : 1 + TAG_BYTES], datagram[1 + TAG_BYTES :]
        if self._dialer is None or tag != self._tag:
            return self._refuse(heard, "answers to no call")
        dialer, self._dialer = self._dialer, None
        try:
            said, keys = dialer.finish(content)
        except HandshakeError:
            return self._refuse(heard, "answers with another key")
        self.refused = False
        self.busy = said[:1] == BUSY
        if self.busy:
            return heard
        self.welcome = said[1:]
        self._peer = _Peer(keys)
        self._peer.address, self._peer.heard_ns = address, now_ns
        heard.connected = True
        return heard
