"""The other side of a link, under the keys of its newest session and, for a moment, the one before.

New keys are agreed on while the old ones are in use. Each side seals with the new ones once it
knows that the other has them: who asked for them with its next message, which tells the other so,
and with its next packet of media once something came under them; who answered with what follows
that message. What was sealed before may still come for a while.
"""

from __future__ import annotations

from tams_app.link.addresses import Address
from tams_app.link.handshake import SessionKeys
from tams_app.link.sealing import (
    HAND_BYTES,
    STATE_BYTES,
    Media,
    MessageOpener,
    MessageSealer,
    session_number,
)
from tams_app.units import NS_PER_S

MESSAGE = 0xC9
PREFIX = b"\0"  # of messages of the link itself; those of the applications begin otherwise
OVERLAP_NS = 5 * NS_PER_S  # media that old keys sealed is taken for so long


class LinkSession:
    """The keys of one handshake, in use."""

    def __init__(self, keys: SessionKeys, began_ns: int) -> None:
        self.number = keys.number
        self.began_ns = began_ns
        self.media = Media(keys)
        self.sealer = MessageSealer(keys.send.messages, MESSAGE, keys.number)
        self.opener = MessageOpener(keys.receive.messages)


class Peer:
    """The other side. `address`: where it is; `heard_ns`: when something of it came last."""

    def __init__(self, session: LinkSession, address: Address, now_ns: int, asks: bool) -> None:
        """`asks`: whether new keys are this side's to ask for."""
        self.address, self.heard_ns = address, now_ns
        self.late = 0  # messages that were repeated or overtaken
        self.sessions = 1  # how often there were new keys
        self._asks = asks
        self._session = session
        self._next: LinkSession | None = None
        self._before: LinkSession | None = None
        self._before_until_ns = 0

    @property
    def began_ns(self) -> int:
        """When the keys that are in use were agreed on."""
        return self._session.began_ns

    @property
    def has_next(self) -> bool:
        """Whether there are new keys that the other side has not used yet."""
        return self._next is not None

    def agree(self, session: LinkSession) -> None:
        """There are new keys, which are in use as soon as the other side uses them."""
        self._next = session

    def seal(self, message: bytes) -> bytes:
        """The datagram of a message."""
        session = self._next if self._asks and self._next is not None else self._session
        if message.startswith(PREFIX):
            return session.sealer.seal(message)
        return session.sealer.seal(message, HAND_BYTES if self._asks else STATE_BYTES)

    def protect(self, packet: bytes) -> bytes | None:
        """The datagram of an RTP or RTCP packet; None if it is neither."""
        return self._session.media.protect(packet)

    def open(self, datagram: bytes, now_ns: int) -> bytes | None:
        """The message of a datagram; None if it is not authentic, or none that is newer."""
        number = session_number(datagram)
        if number == self._session.number:
            return self._opened(self._session, datagram)
        if self._next is not None and number == self._next.number:
            message = self._opened(self._next, datagram)
            if message is not None:
                self._turn(now_ns)
            return message
        if self._before is not None and number == self._before.number:
            self.late += 1
        return None

    def unprotect(self, packet: bytes, now_ns: int) -> bytes | None:
        """The RTP or RTCP packet; None if it is not authentic, or was received before."""
        opened = self._session.media.unprotect(packet)
        if opened is None and self._next is not None:
            opened = self._next.media.unprotect(packet)
            if opened is not None:
                self._turn(now_ns)
            return opened
        if opened is None and self._before is not None:
            if now_ns < self._before_until_ns:
                return self._before.media.unprotect(packet)
            self._before = None
        return opened

    def _opened(self, session: LinkSession, datagram: bytes) -> bytes | None:
        late = session.opener.late
        message = session.opener.open(datagram)
        self.late += session.opener.late - late
        return message

    def _turn(self, now_ns: int) -> None:
        """The other side uses the new keys."""
        assert self._next is not None
        self._before, self._before_until_ns = self._session, now_ns + OVERLAP_NS
        self._session, self._next = self._next, None
        self.sessions += 1
