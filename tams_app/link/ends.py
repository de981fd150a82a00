"""What each end of the link does with a datagram: pure, with times and addresses as arguments.

One UDP port carries everything; the first byte tells what a datagram is (as RFC 7983 has it: 128 to
191 are RTP and RTCP; ours are above). A datagram that no key of ours made is not answered and
changes nothing but a counter.

`RobotEnd` here is called; `operator_end.OperatorEnd` calls. A caller becomes the operator with the
first message under the keys of its own handshake, so that a recorded one, sent again, comes to
nothing. There is one operator at a time: while one is heard, or was a moment ago, others are told
that it is busy. Nothing goes to an operator who is silent (consent, as RFC 7675 has it), or to an
address that has not answered a question (as RFC 9000, 8.2, has it).
"""

from __future__ import annotations

from collections import Counter, OrderedDict, deque
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

from tams_app.link.addresses import Address, named
from tams_app.link.handshake import (
    BUSY,
    COOKIE,
    EPHEMERAL_BYTES,
    INITIATION,
    INITIATION_BYTES,
    MAC_BYTES,
    PROLOGUE,
    REKEY_PROLOGUE,
    RESPONSE,
    TAG_BYTES,
    Cookies,
    Initiation,
    answer,
    filled,
    names_no_key,
    read_initiation,
    session_keys,
    unfilled,
)
from tams_app.link.keys import Key
from tams_app.link.noise import OVERHEAD_BYTES, NoiseError, Responder
from tams_app.link.peer import MESSAGE, PREFIX, LinkSession, Peer
from tams_app.units import NS_PER_MS, NS_PER_S

MEDIA = range(128, 192)
# Messages of the link itself:
GOODBYE = PREFIX + b"goodbye"
REKEY, REKEYED = PREFIX + b"rekey", PREFIX + b"keyed"  # and a message of Noise
QUESTION, REPLY = PREFIX + b"where", PREFIX + b"here!"  # and a token: is the operator there?
PING, PONG = PREFIX + b"ping", PREFIX + b"pong"  # and anything, which comes back

LET_GO_NS = 3 * NS_PER_S  # an operator who is not heard for so long has let go
ATTEMPT_NS = 5 * NS_PER_S  # a handshake that came to nothing is begun anew, with other keys
OUTWORN_NS = 600 * NS_PER_S  # keys that are older are not used
WELCOME_BYTES = INITIATION_BYTES - 1 - TAG_BYTES - OVERHEAD_BYTES - MAC_BYTES
_TOKEN_BYTES = 8
_QUESTION_NS = 100 * NS_PER_MS
# More than an operator's side can begin while one cookie is valid, so that recordings of its own
# initiations, sent from its address, take no place from it and cost one exchange each.
_CALLS_OF_AN_ADDRESS = 8
_ADDRESSES = 64
_RESPONSES_TO_A_CALL = 40  # of an attempt's initiations each; more are recordings
_CALL_KEPT_NS = 2 * ATTEMPT_NS
_PROTOCOL_1 = range(0xC1, 0xC5)  # how its datagrams begin
_REFUSAL_NS = 10 * NS_PER_S  # a cause is reported so often at most, whoever calls how often


@dataclass(slots=True)
class Heard:
    """What became of one datagram."""

    replies: list[tuple[bytes, Address]] = field(default_factory=list)
    message: bytes | None = None
    media: bytes | None = None
    connected: bool = False  # a new session with an operator has begun with this datagram
    left: bool = False  # the other side has said goodbye, or its key is accepted no longer


class End:
    """What both ends do."""

    def __init__(self, random: Callable[[int], bytes]) -> None:
        """`random`: so many random bytes."""
        self.counts: Counter[str] = Counter()  # datagrams that changed nothing, by reason
        self._random = random
        self._peer: Peer | None = None

    @property
    def connected(self) -> bool:
        """Whether there is a session; the other side may be silent all the same."""
        return self._peer is not None

    @property
    def address(self) -> Address:
        """Where the other side is, or was."""
        return ("", 0) if self._peer is None else self._peer.address

    @property
    def renewals(self) -> int:
        """How often the keys of the session that there is were replaced."""
        return 0 if self._peer is None else self._peer.sessions - 1

    def silent_ns(self, now_ns: int) -> int | None:
        """Since when nothing was heard; None without a session."""
        return None if self._peer is None else now_ns - self._peer.heard_ns

    def message(self, content: bytes, now_ns: int) -> tuple[bytes, Address] | None:
        """The datagram that carries a message, and where to; None if nothing may be sent."""
        peer = self._may_send(now_ns)
        return None if peer is None else (peer.seal(content), peer.address)

    def media(self, packet: bytes, now_ns: int) -> tuple[bytes, Address] | None:
        """The datagram of an RTP or RTCP packet, and where to; None if it is neither, or no."""
        peer = self._may_send(now_ns)
        protected = None if peer is None else peer.protect(packet)
        return None if peer is None or protected is None else (protected, peer.address)

    def _may_send(self, now_ns: int) -> Peer | None:
        self._wear_out(now_ns)
        return self._peer

    def _wear_out(self, now_ns: int) -> None:
        """Without new keys for so long there is no session any more."""
        if self._peer is not None and now_ns - self._peer.began_ns >= OUTWORN_NS:
            self._peer = None

    def _open(self, datagram: bytes, now_ns: int) -> Heard:
        """A message or a packet of the session that there is."""
        heard, peer = Heard(), self._peer
        if peer is None:
            return self._refuse(heard, "without a session")
        if datagram[0] == MESSAGE:
            late = peer.late
            heard.message = peer.open(datagram, now_ns)
            if heard.message is None:
                return self._refuse(heard, "late" if peer.late > late else "not authentic")
        else:
            heard.media = peer.unprotect(datagram, now_ns)
            if heard.media is None:
                return self._refuse(heard, "media not authentic")
        self._wear_out(now_ns)
        if self._peer is None:
            return self._refuse(Heard(), "without a session")
        peer.heard_ns = now_ns
        if heard.message == GOODBYE:
            heard.message, heard.left = None, True
            self._peer = None
        return heard

    def _refuse(self, heard: Heard, reason: str) -> Heard:
        self.counts[reason] += 1
        return heard


@dataclass(slots=True)
class _Call:
    """An initiation that was answered, and not confirmed yet."""

    key: Key
    noise: bytes
    response: bytes
    session: LinkSession
    address: Address
    introduction: bytes
    answered_ns: int  # the first time
    answers: int = 0


@dataclass(slots=True)
class _Question:
    """Asked at an address that a message came from: who receives there can send the token back."""

    address: Address
    token: bytes
    asked_ns: int


class RobotEnd(End):
    """The end that waits for an operator."""

    def __init__(
        self, keys: Mapping[bytes, Key], welcome: bytes, random: Callable[[int], bytes]
    ) -> None:
        """`keys`: those that are accepted, by identity. `welcome`: what an operator is told."""
        super().__init__(random)
        self.operator = ""  # the name of the key of the connected operator, or of the last one
        self.introduction = b""  # what their side has told with its call
        self.refusal = ""  # who called last in vain and why, for the people at this end alone
        self._refused_ns: dict[str, int] = {}  # when one was reported, by cause
        self._reported: deque[str] = deque(maxlen=64)
        self._keys = keys
        self._key: Key | None = None  # theirs
        self._welcome = welcome
        self._cookies = Cookies(random(EPHEMERAL_BYTES))
        self._calls: OrderedDict[tuple[Address, bytes], _Call] = OrderedDict()
        self._rekeyed: tuple[bytes, bytes] | None = None  # what was asked, and answered
        self._question: _Question | None = None

    def accept(self, keys: Mapping[bytes, Key], now_ns: int) -> Heard:
        """Accept these keys from now on; an operator with another one is disconnected."""
        self._keys = keys
        for name, call in list(self._calls.items()):
            if call.key.identity not in keys:
                del self._calls[name]
        heard = Heard()
        if self._peer is not None and self._key is not None and self._key.identity not in keys:
            goodbye = self.message(GOODBYE, now_ns)
            heard.replies = [] if goodbye is None else [goodbye]
            heard.left, self._peer = True, None
        return heard

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> Heard:
        """Take one datagram in."""
        kind = datagram[0] if datagram else 0
        if kind == INITIATION:
            return self._called(datagram, address, now_ns)
        if kind == MESSAGE:
            return self._confirmed(datagram, now_ns) or self._said(datagram, address, now_ns)
        if kind in MEDIA:
            return self._open(datagram, now_ns)
        if kind in _PROTOCOL_1:
            self._report(
                "another version of TAMS calls, whose link this one does not have", address, now_ns
            )
        return self._refuse(Heard(), "of no known kind")

    def _report(self, cause: str, address: Address, now_ns: int) -> None:
        """Keep who called in vain. Nothing is answered: a stranger learns nothing by it."""
        if now_ns - self._refused_ns.get(cause, -_REFUSAL_NS) < _REFUSAL_NS:
            return
        refusal = f"{named(address)} is not answered: {cause}"
        if refusal not in self._reported:  # who calls on and on hides no other caller
            self._refused_ns[cause] = now_ns
            self._reported.append(refusal)
            self.refusal = refusal

    # --- who gets in ----------------------------------------------------------------------------

    def _called(self, datagram: bytes, address: Address, now_ns: int) -> Heard:
        heard = Heard()
        call = read_initiation(datagram, self._keys)
        if call is None:
            if names_no_key(datagram, self._keys):
                self._report("the key of who calls is not accepted here", address, now_ns)
            return self._refuse(heard, "initiations that no key made")
        if not self._cookies.is_valid(call.cookie, address, now_ns):
            kind, content = COOKIE, self._cookies.of(address, now_ns)
        elif self._is_busy(now_ns):
            kind, content = BUSY, b""
        else:
            response = self._response(call, address, now_ns)
            if response is None:
                return self._refuse(heard, "initiations that were answered")
            kind, content = RESPONSE, response
        heard.replies.append((answer(kind, call.tag, call.key, call.mac, content), address))
        return heard

    def _is_busy(self, now_ns: int) -> bool:
        self._wear_out(now_ns)
        silent_ns = self.silent_ns(now_ns)
        return silent_ns is not None and silent_ns < LET_GO_NS

    def _response(self, initiation: Initiation, address: Address, now_ns: int) -> bytes | None:
        """The answer to the connected operator's initiation; None if it was given often enough."""
        self._forget_calls(now_ns)
        name = (address, initiation.tag)
        call = self._calls.get(name)
        if call is None or call.noise != initiation.noise:
            try:
                responder = Responder(initiation.key.secret, PROLOGUE, initiation.noise)
                response, split = responder.answer(
                    self._random(EPHEMERAL_BYTES), filled(self._welcome, WELCOME_BYTES)
                )
            except NoiseError:  # its MAC was ours: the other side is not sound
                return None
            session = LinkSession(session_keys(split, initiator=False), now_ns)
            call = _Call(
                initiation.key,
                initiation.noise,
                response,
                session,
                address,
                unfilled(responder.payload),
                now_ns,
            )
            self._keep(name, call)
        call.answers += 1
        return call.response if call.answers <= _RESPONSES_TO_A_CALL else None

    def _keep(self, name: tuple[Address, bytes], call: _Call) -> None:
        self._calls[name] = call
        of_address = [one for one in self._calls if one[0] == call.address]
        for one in of_address[:-_CALLS_OF_AN_ADDRESS]:
            del self._calls[one]
        while len(self._calls) > _CALLS_OF_AN_ADDRESS * _ADDRESSES:
            self._calls.popitem(last=False)

    def _forget_calls(self, now_ns: int) -> None:
        for name, call in list(self._calls.items()):
            if now_ns - call.answered_ns > _CALL_KEPT_NS:
                del self._calls[name]

    def _confirmed(self, datagram: bytes, now_ns: int) -> Heard | None:
        """The first message of a call: the caller is who they say, now. None if it is not one."""
        if not self._calls or self._is_busy(now_ns):
            return None
        self._forget_calls(now_ns)
        for name, call in self._calls.items():
            peer = Peer(call.session, call.address, now_ns, asks=False)
            message = peer.open(datagram, now_ns)
            if message is None:
                continue
            del self._calls[name]
            if message == GOODBYE:  # of a caller who has not become the operator
                return Heard()
            self._peer, self._key, self.operator = peer, call.key, call.key.name
            self.introduction = call.introduction
            self._rekeyed = self._question = None
            return Heard(message=message, connected=True)
        return None

    # --- who is in ------------------------------------------------------------------------------

    def _may_send(self, now_ns: int) -> Peer | None:
        """The operator, if a message of theirs arrived recently; else None."""
        return super()._may_send(now_ns) if self._is_busy(now_ns) else None

    def _said(self, datagram: bytes, address: Address, now_ns: int) -> Heard:
        heard, peer = self._open(datagram, now_ns), self._peer
        if heard.message is None or peer is None:
            return heard
        said = heard.message
        if said.startswith(REKEY):
            heard.message = None
            heard.replies += self._rekey(peer, said[len(REKEY) :], address, now_ns)
        elif said.startswith(REPLY):
            heard.message, asked = None, self._question
            if asked is not None and (asked.address, asked.token) == (address, said[len(REPLY) :]):
                peer.address, self._question = address, None
        if address != peer.address:
            heard.replies += self._ask(peer, address, now_ns)
        return heard

    def _ask(self, peer: Peer, address: Address, now_ns: int) -> list[tuple[bytes, Address]]:
        """Ask at an address whether the operator is there: no other datagram goes there before."""
        asked = self._question
        if asked is not None and now_ns - asked.asked_ns < _QUESTION_NS:
            return []  # so often at most, at all addresses together
        if asked is None or asked.address != address:
            asked = self._question = _Question(address, self._random(_TOKEN_BYTES), now_ns)
        asked.asked_ns = now_ns
        return [(peer.seal(QUESTION + asked.token), address)]

    def _rekey(
        self, peer: Peer, asked: bytes, address: Address, now_ns: int
    ) -> list[tuple[bytes, Address]]:
        """Agree on new keys with the connected operator."""
        if self._key is None or address != peer.address:
            return []  # it asks again, from where it is then known to be
        if self._rekeyed is None or self._rekeyed[0] != asked:
            try:
                responder = Responder(self._key.secret, REKEY_PROLOGUE, asked)
                response, split = responder.answer(self._random(EPHEMERAL_BYTES), b"")
            except NoiseError:
                self.counts["new keys that came to nothing"] += 1
                return []
            peer.agree(LinkSession(session_keys(split, initiator=False), now_ns))
            self._rekeyed = asked, response
        return [(peer.seal(REKEYED + self._rekeyed[1]), address)]
