"""The end of the link that waits for an operator: many may knock, one is in.

A stranger's packet is not answered. A caller's greeting is, with a Retry packet that costs one hash
and keeps nothing; who comes back with it may shake hands and has two seconds to prove a key. There
is one operator at a time: while one is heard, or was a moment ago, others are told that it is busy.
Nothing goes to an operator who is silent (consent, as RFC 7675 has it), or to an address that has
not answered a question (as RFC 9000, 8.2, has it).
"""

from __future__ import annotations

import hmac
from collections import OrderedDict, deque
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass

from tams_app.link.addresses import Address, named
from tams_app.link.certificate import Leaf
from tams_app.link.channel import (
    LET_GO_NS,
    LINK,
    QUESTION,
    RENEW_NS,
    REPLY,
    STATE_BYTES,
    Channel,
    End,
    Heard,
)
from tams_app.link.keys import Key
from tams_app.link.pages import Pages, most_crowded
from tams_app.link.proof import (
    NONCE_BYTES,
    WELCOME_BYTES,
    Busy,
    Challenge,
    Meeting,
    Proof,
    Welcome,
    answer,
    filled,
    framed,
    names_no_key,
    read_greeting,
    split_answer,
    unfilled,
)
from tams_app.link.quic import (
    ID_BYTES,
    LONG_HEADER,
    VERSION,
    Came,
    Connection,
    Initial,
    Retries,
    destination_of,
    read_initial,
)
from tams_app.link.webtransport import PageConnection
from tams_app.units import NS_PER_MS, NS_PER_S

UNPROVEN = 8  # connections of callers who have not proved a key yet; as many of pages
PROVE_NS = 2 * NS_PER_S
HANDSHAKES = 5  # begun in a second with each key
_GREETINGS_KEPT = 4096  # by which a handshake was begun, and none is again
_SECRET_BYTES = 32
_TOKEN_BYTES = 8
_QUESTION_NS = 100 * NS_PER_MS
_OLD_PROTOCOLS = range(0xC1, 0xC6)  # how datagrams of 1 and 2 begin
_REFUSAL_NS = 10 * NS_PER_S  # a cause is reported so often at most, whoever calls how often


@dataclass(slots=True)
class _Knock:
    """A connection whose caller has not proved a key. `answered`: they were told *busy*."""

    channel: Channel
    certificate: bytes  # DER
    nonce: bytes
    answered: bool = False


@dataclass(slots=True)
class _Question:
    """Asked at an address that a message came from: who receives there can send the token back."""

    address: Address
    token: bytes
    asked_ns: int


class Door(End):
    """The robot's end."""

    def __init__(
        self,
        keys: Mapping[bytes, Key],
        leaf: Leaf,
        welcome: bytes,
        random: Callable[[int], bytes],
    ) -> None:
        """`keys`: those that are accepted, by identity. `welcome`: what an operator is told."""
        super().__init__(random)
        self.operator = ""  # the name of the key of the connected operator, or of the last one
        self.introduction = b""  # what their side has told with its call
        self.refusal = ""  # who called last in vain and why, for the people at this end alone
        self.leaf = leaf  # shown to who calls from now on
        self._refused_ns: dict[str, int] = {}  # when one was reported, by cause
        self._reported: deque[str] = deque(maxlen=64)
        self.pages: Pages | None = None  # that may call; None: no packet of a browser is answered
        self._keys = keys
        self._key: Key | None = None  # theirs
        self._welcome = filled(welcome, WELCOME_BYTES)
        self._retries = Retries(random(_SECRET_BYTES))
        self._knocks: list[_Knock] = []
        self._begun_ns: dict[bytes, deque[int]] = {}  # the last handshakes, by key
        self._greetings: OrderedDict[bytes, None] = OrderedDict()
        self._question: _Question | None = None

    def accept(self, keys: Mapping[bytes, Key], now_ns: int) -> Heard:
        """Accept these keys from now on; an operator with another one is disconnected."""
        self._keys = keys
        heard = Heard()
        if self._channel is not None and self._key is not None and not self._is_accepted(self._key):
            heard.replies = self.goodbye(now_ns)
            heard.left = True
            if self._channel is not None:
                self._drop(self._channel)
        return heard

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> Heard:
        """Take one datagram in."""
        channel = self._routes.get(destination_of(datagram)) if datagram else None
        if channel is not None:
            if channel is not self._channel and address != channel.address:
                return self._refuse("calls from two addresses")  # a copy: the caller's goes on
            came = self._received(channel, datagram, now_ns)
            if channel is self._channel:
                return self._told(channel, came, address, now_ns)
            return self._knocked(channel, came, now_ns)
        if datagram and datagram[0] & LONG_HEADER:
            return self._called(datagram, address, now_ns)
        return self._refuse("without a session" if datagram else "of no known kind")

    def step(self, now_ns: int) -> list[tuple[bytes, Address]]:
        """What is to be sent now; who has not proved a key for too long is forgotten."""
        for knock in list(self._knocks):
            if now_ns - knock.channel.began_ns >= PROVE_NS or knock.channel.connection.ended:
                self._forget(knock)
        channel = self._channel
        if channel is not None and _is_page(channel) and now_ns - channel.renewed_ns >= RENEW_NS:
            channel.renewed_ns = now_ns
            channel.connection.renew_keys()  # which browsers never do
        return self._timed(now_ns)

    def _is_accepted(self, key: Key) -> bool:
        is_page = self.pages is not None and key is self.pages.key
        return is_page or key.identity in self._keys

    def _refuse(self, reason: str) -> Heard:
        self.counts[reason] += 1
        return Heard()

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
        initial = read_initial(datagram)
        if initial is None:
            if datagram[0] in _OLD_PROTOCOLS and datagram[1:5] != VERSION:
                cause = "another version of TAMS calls, whose link this one does not have"
                self._report(cause, address, now_ns)
            return self._refuse("of no known kind")
        if self.pages is not None:
            if not initial.token:
                return self._ask_back(initial, b"", address, now_ns)
            proved = self._retries.read(initial.token, initial.destination, address, now_ns)
            if proved is not None and not proved[1]:  # what a greeting is answered with has it
                return self._page_begun(self.pages, proved[0], datagram, address, now_ns)
        token, _ = split_answer(initial.token)
        proved = self._retries.read(token, initial.destination, address, now_ns)
        if proved is not None:
            return self._begun(initial, proved, datagram, address, now_ns)
        if read_greeting(initial.token, self._keys) is None:
            if names_no_key(initial.token, self._keys):
                self._report("the key of who calls is not accepted here", address, now_ns)
            return self._refuse("calls that no key made")
        return self._ask_back(initial, initial.token, address, now_ns)

    def _ask_back(self, initial: Initial, said: bytes, address: Address, now_ns: int) -> Heard:
        here = self._random(ID_BYTES)
        retry = self._retries.retry(initial, address, here, said, now_ns)
        return Heard(replies=[(retry, address)])

    def _begun(
        self,
        initial: Initial,
        proved: tuple[bytes, bytes],
        datagram: bytes,
        address: Address,
        now_ns: int,
    ) -> Heard:
        """Begin to shake hands with who has come back with what a Retry packet gave them."""
        original, greeting = proved
        key = read_greeting(greeting, self._keys)
        token, answered = split_answer(initial.token)
        if key is None or not hmac.compare_digest(answered, answer(key, token)):
            return self._refuse("calls that no key made")  # a greeting was recorded
        if greeting in self._greetings:
            return self._refuse("calls that were answered")
        begun_ns = self._begun_ns.setdefault(key.identity, deque(maxlen=HANDSHAKES))
        if len(begun_ns) == HANDSHAKES and now_ns - begun_ns[0] < NS_PER_S:
            return self._refuse("calls that were too many")
        begun_ns.append(now_ns)
        connection = Connection.called(self.leaf, original, initial.destination)
        knock = self._knock(connection, datagram, address, now_ns)
        if knock is None:
            return self._refuse("calls that came to nothing")
        self._greetings[greeting] = None
        if len(self._greetings) > _GREETINGS_KEPT:
            self._greetings.popitem(last=False)
        return knock

    def _page_begun(
        self, pages: Pages, original: bytes, datagram: bytes, address: Address, now_ns: int
    ) -> Heard:
        """The same with a browser."""
        if not pages.may_begin(address, now_ns):
            return self._refuse("calls that were too many")
        retry = destination_of(datagram)
        connection = PageConnection(self.leaf, original, retry, pages.origins)
        knocked = self._knock(connection, datagram, address, now_ns)
        return self._refuse("calls that came to nothing") if knocked is None else knocked

    def _knock(
        self, connection: Connection, datagram: bytes, address: Address, now_ns: int
    ) -> Heard | None:
        """Keep a new connection; None if its first packet is not authentic.

        A damaged copy is not to take the place of the packet itself.
        """
        channel = Channel(connection, address, STATE_BYTES, now_ns)
        came = self._received(channel, datagram, now_ns)
        if not connection.is_heard:
            return None
        like = [one for one in self._knocks if _is_page(one.channel) == _is_page(channel)]
        if len(like) >= UNPROVEN:
            self._forget(like[most_crowded([one.channel.address for one in like])])
        self._knocks.append(_Knock(channel, self.leaf.der, self._random(NONCE_BYTES)))
        for name in (destination_of(datagram), connection.first_id):
            self._routes[name] = channel
        return self._knocked(channel, came, now_ns)

    def _forget(self, knock: _Knock) -> None:
        if knock in self._knocks:  # or it has become the operator's, and ended at once
            self._knocks.remove(knock)
        self._drop(knock.channel)

    def _knocked(self, channel: Channel, came: Came, now_ns: int) -> Heard:
        """Something came of who has not proved a key."""
        knock = next(one for one in self._knocks if one.channel is channel)
        if knock.answered and came.contents:  # their goodbye
            self._forget(knock)
            return Heard()
        if came.begun:
            channel.connection.write(framed(Challenge(knock.nonce)))
        heard = Heard()
        for word in channel.words.of(came.stream):
            if isinstance(word, Proof) and not knock.answered:
                heard.connected = self._proved(knock, word, now_ns)
        if channel.connection.ended or channel.words.ended:
            self._forget(knock)
            return self._refuse("calls that came to nothing")
        heard.replies += channel.datagrams(now_ns)
        return heard

    def _proved(self, knock: _Knock, proof: Proof, now_ns: int) -> bool:
        """Whether they have become the operator by this proof."""
        channel, key = knock.channel, self._key_of(knock, proof)
        knock.answered = True
        if key is None:
            self.counts["calls that no key made"] += 1
            channel.words.ended = True
            if _is_page(channel):
                cause = "the page that calls has another session's link"
                self._report(cause, channel.address, now_ns)
            return False
        meeting = Meeting(key, knock.certificate, knock.nonce, proof.nonce)
        if self._is_busy(now_ns):
            channel.connection.write(framed(Busy()))
            return False
        if self._channel is not None:
            self._drop(self._channel)
        self._knocks.remove(knock)
        self._channel, self._key, self.operator = channel, key, key.name
        self.introduction = unfilled(proof.introduction)
        self._question = None
        channel.heard_ns = channel.renewed_ns = now_ns
        channel.connection.write(framed(Welcome(self._welcome, meeting.welcome(self._welcome))))
        return True

    def _key_of(self, knock: _Knock, proof: Proof) -> Key | None:
        """The key that they prove to have."""
        key = self._keys.get(proof.key)
        if self.pages is not None and _is_page(knock.channel):
            key = self.pages.key if proof.key == self.pages.key.identity else None
        if key is None or len(proof.nonce) != NONCE_BYTES:
            return None
        mac = Meeting(key, knock.certificate, knock.nonce, proof.nonce).proof(proof.introduction)
        return key if hmac.compare_digest(mac, proof.mac) else None

    def _is_busy(self, now_ns: int) -> bool:
        self._wear_out(now_ns)
        silent_ns = self.silent_ns(now_ns)
        return silent_ns is not None and silent_ns < LET_GO_NS

    # --- who is in ------------------------------------------------------------------------------

    def _may_send(self, now_ns: int) -> Channel | None:
        """The operator, if something of theirs arrived recently; else None."""
        return super()._may_send(now_ns) if self._is_busy(now_ns) else None

    def _active(self, now_ns: int) -> Iterator[Channel]:
        yield from super()._active(now_ns)
        yield from (knock.channel for knock in self._knocks)

    def _told(self, channel: Channel, came: Came, address: Address, now_ns: int) -> Heard:
        heard = self._said(channel, came, address, now_ns)
        if _is_page(channel) and channel.connection.ended:
            heard.left = False  # reloaded, or its browser was ended: they may come back
        if heard.messages and channel is self._channel and address != channel.address:
            heard.replies += self._ask(channel, address, now_ns)
        return heard

    def _link_said(
        self, heard: Heard, channel: Channel, said: bytes, address: Address, now_ns: int
    ) -> None:
        asked = self._question
        if not said.startswith(REPLY):
            super()._link_said(heard, channel, said, address, now_ns)
        elif asked is not None and (asked.address, asked.token) == (address, said[len(REPLY) :]):
            channel.address, self._question = address, None

    def _ask(self, channel: Channel, address: Address, now_ns: int) -> list[tuple[bytes, Address]]:
        """Ask at an address whether the operator is there: no other datagram goes there before."""
        asked = self._question
        if asked is not None and now_ns - asked.asked_ns < _QUESTION_NS:
            return []  # so often at most, at all addresses together
        if asked is None or asked.address != address:
            asked = self._question = _Question(address, self._random(_TOKEN_BYTES), now_ns)
        asked.asked_ns = now_ns
        sent = channel.datagrams(now_ns)  # what is due goes where they are known to be
        channel.message(QUESTION + asked.token, LINK)
        return sent + [(one, address) for one, _ in channel.datagrams(now_ns)]


def _is_page(channel: Channel) -> bool:
    return isinstance(channel.connection, PageConnection)
