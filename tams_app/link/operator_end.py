"""The end of the link that calls: until it is answered, and again when nothing is heard any more.

While there is a session it asks for new keys every two minutes, and when SRTP's packet index is
lost: after 32,768 packets in a row that did not arrive (RFC 3711, 3.3.1), or a few where a stream's
sequence numbers wrap before its first packet has come. Then messages are authentic, and every
packet of a stream is refused.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Sequence
from dataclasses import dataclass, field

from tams_app.link.addresses import Address
from tams_app.link.ends import (
    ATTEMPT_NS,
    MEDIA,
    OUTWORN_NS,
    QUESTION,
    REKEY,
    REKEYED,
    REPLY,
    End,
    Heard,
)
from tams_app.link.handshake import (
    BUSY,
    COOKIE,
    COOKIE_BYTES,
    EPHEMERAL_BYTES,
    MAC_BYTES,
    NO_COOKIE,
    PADDING_BYTES,
    PROLOGUE,
    REKEY_PROLOGUE,
    RESPONSE,
    TAG_BYTES,
    filled,
    initiation,
    read_answer,
    session_keys,
    unfilled,
)
from tams_app.link.keys import Key
from tams_app.link.noise import Initiator, NoiseError
from tams_app.link.peer import MESSAGE, LinkSession, Peer
from tams_app.link.sealing import is_rtcp, ssrc_of
from tams_app.units import NS_PER_MS, NS_PER_S

REDIAL_NS = 2 * NS_PER_S  # not heard for so long: call again
REKEY_NS = 120 * NS_PER_S  # as WireGuard; long before `OUTWORN_NS`, when keys are not used any more
assert REKEY_NS < OUTWORN_NS
REFUSED_NS = 2 * NS_PER_S  # a stream of which nothing else has come for so long has lost its index
LONGEST_INTRODUCTION_BYTES = 256
_AGAIN_NS = 250 * NS_PER_MS  # between two initiations
_JITTER_NS = 50 * NS_PER_MS  # more or less, so that nothing can keep step with them


@dataclass(slots=True)
class _Attempt:
    """A handshake that was begun; `mac`: of the initiation that was sent last."""

    noise: Initiator
    tag: bytes
    began_ns: int
    again_ns: int = 0  # when to send it the next time
    mac: bytes = b""


@dataclass(slots=True)
class _Refusals:
    """Streams of which packets are refused: since when no other has come [ns], by SSRC."""

    since_ns: dict[int, int] = field(default_factory=dict)
    streams: frozenset[int] = frozenset()

    def step(self, packet: bytes, refused: bool, now_ns: int) -> None:
        ssrc = ssrc_of(packet)
        if not refused:
            self.since_ns.pop(ssrc, None)
        elif ssrc in self.streams:
            self.since_ns.setdefault(ssrc, now_ns)

    def last(self, now_ns: int) -> bool:
        return any(now_ns - since_ns >= REFUSED_NS for since_ns in self.since_ns.values())


class OperatorEnd(End):
    """The end that calls."""

    def __init__(
        self,
        key: Key,
        robots: Sequence[Address],
        random: Callable[[int], bytes],
        introduction: bytes = b"",
    ) -> None:
        """`introduction`: what the robot's side is told with the call, if it is short enough.

        `robots`: the addresses of the robot's side: all are called, and what answers first counts.
        """
        super().__init__(random)
        self._introduction = filled(introduction[:LONGEST_INTRODUCTION_BYTES], PADDING_BYTES)
        self.welcome: bytes | None = None  # what the robot's side said last
        self.busy = False  # the robot's side has another operator
        self._key, self._robots = key, tuple(robots)
        self._cookie = NO_COOKIE
        self._attempt: _Attempt | None = None  # to begin a session
        self._renewal: _Attempt | None = None  # to renew its keys
        self._refusals = _Refusals()

    def follow(self, streams: Collection[int]) -> None:
        """Which streams are to come, by SSRC: of these a lost index is noticed."""
        self._refusals = _Refusals(streams=frozenset(streams))

    def step(self, now_ns: int) -> list[tuple[bytes, Address]]:
        """Initiations that are to be sent now, and requests for new keys."""
        self._wear_out(now_ns)
        silent_ns = self.silent_ns(now_ns)
        if silent_ns is None or silent_ns >= REDIAL_NS:
            return self._call(now_ns)
        self._attempt = None
        return self._rekey(now_ns)

    def receive(self, datagram: bytes, address: Address, now_ns: int) -> Heard:
        """Take one datagram in; where it comes from only tells which address has answered."""
        kind = datagram[0] if datagram else 0
        if kind in (COOKIE, BUSY, RESPONSE):
            return self._answered(kind, datagram, address, now_ns)
        if kind == MESSAGE or kind in MEDIA:
            return self._said(datagram, now_ns)
        return self._refuse(Heard(), "of no known kind")

    # --- the handshake --------------------------------------------------------------------------

    def _call(self, now_ns: int) -> list[tuple[bytes, Address]]:
        attempt = self._attempt
        if attempt is None or now_ns - attempt.began_ns >= ATTEMPT_NS:
            again_ns = now_ns if attempt is None else attempt.again_ns
            attempt = self._attempt = self._begin(PROLOGUE, self._introduction, now_ns, again_ns)
        if now_ns < attempt.again_ns:
            return []
        attempt.again_ns = self._next_ns(now_ns)
        datagram = self._initiation(attempt)
        return [(datagram, address) for address in self._robots]

    def _initiation(self, attempt: _Attempt) -> bytes:
        datagram = initiation(self._key, attempt.tag, self._cookie, attempt.noise.message)
        attempt.mac = datagram[-MAC_BYTES:]
        return datagram

    def _answering(self, address: Address) -> Address:
        """The one of the robot's addresses that this is: no other is ever sent to."""
        return address if address in self._robots else self._robots[0]

    def _next_ns(self, now_ns: int) -> int:
        drawn = int.from_bytes(self._random(4)) / 2**32
        return now_ns + _AGAIN_NS + round((2 * drawn - 1) * _JITTER_NS)

    def _begin(self, prologue: bytes, payload: bytes, now_ns: int, again_ns: int) -> _Attempt:
        noise = Initiator(self._key.secret, prologue, self._random(EPHEMERAL_BYTES), payload)
        return _Attempt(noise, self._random(TAG_BYTES), now_ns, again_ns)

    def _answered(self, kind: int, datagram: bytes, address: Address, now_ns: int) -> Heard:
        heard, attempt = Heard(), self._attempt
        if attempt is None:
            return self._refuse(heard, "answers to no call")
        content = read_answer(datagram, attempt.tag, self._key, attempt.mac)
        if content is None:
            return self._refuse(heard, "answers that are not authentic")
        if kind == COOKIE:
            if len(content) == COOKIE_BYTES and content != self._cookie:
                self._cookie = content
                heard.replies.append((self._initiation(attempt), self._answering(address)))
            return heard
        self.busy = kind == BUSY
        if self.busy:
            return heard
        try:
            said, split = attempt.noise.finish(content)
        except NoiseError:
            return self._refuse(heard, "answers that are not authentic")
        self.welcome = unfilled(said)
        self._attempt = self._renewal = None
        session = LinkSession(session_keys(split, initiator=True), now_ns)
        self._peer = Peer(session, self._answering(address), now_ns, asks=True)
        self._refusals.since_ns.clear()
        heard.connected = True
        return heard

    # --- the session ----------------------------------------------------------------------------

    def _said(self, datagram: bytes, now_ns: int) -> Heard:
        heard = self._open(datagram, now_ns)
        if datagram[0] in MEDIA and not is_rtcp(datagram):
            self._refusals.step(datagram, heard.media is None, now_ns)
        if heard.message is None and heard.media is None:
            return heard
        self.busy = False  # said while it heard us, and we did not hear it
        said = heard.message
        if said is not None and said.startswith(QUESTION):
            heard.message = None
            heard.replies += self._sealed(REPLY + said[len(QUESTION) :], now_ns)
        elif said is not None and said.startswith(REKEYED):
            heard.message = None
            self._agree(said[len(REKEYED) :], now_ns)
        return heard

    def _sealed(self, content: bytes, now_ns: int) -> list[tuple[bytes, Address]]:
        addressed = self.message(content, now_ns)
        return [] if addressed is None else [addressed]

    def _rekey(self, now_ns: int) -> list[tuple[bytes, Address]]:
        """Ask for new keys if it is time, until there is an answer."""
        peer, renewal = self._peer, self._renewal
        assert peer is not None
        due = now_ns - peer.began_ns >= REKEY_NS or self._refusals.last(now_ns)
        if peer.has_next or not (due or renewal):
            return []
        if renewal is None or now_ns - renewal.began_ns >= ATTEMPT_NS:
            renewal = self._renewal = self._begin(REKEY_PROLOGUE, b"", now_ns, now_ns)
        if now_ns < renewal.again_ns:
            return []
        renewal.again_ns = self._next_ns(now_ns)
        return self._sealed(REKEY + renewal.noise.message, now_ns)

    def _agree(self, content: bytes, now_ns: int) -> None:
        peer, renewal = self._peer, self._renewal
        if peer is None or renewal is None:
            return
        try:
            _, split = renewal.noise.finish(content)
        except NoiseError:  # of an attempt before
            self.counts["new keys that came to nothing"] += 1
            return
        self._renewal = None
        self._refusals.since_ns.clear()
        peer.agree(LinkSession(session_keys(split, initiator=True), now_ns))
