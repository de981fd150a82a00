"""What is sent between the two computers, encrypted and authenticated.

Messages: ChaCha20-Poly1305 (RFC 8439) with a counter. Video and its feedback: SRTP and SRTCP
(RFC 3711) with AES-256-GCM (RFC 7714), by libsrtp.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305
from pylibsrtp import Error, Policy, Session

from tams_app.link.handshake import DirectionKeys, SessionKeys

_COUNTER = struct.Struct("!Q")
_HEAD_BYTES = 1 + _COUNTER.size
LONGEST_DATAGRAM_BYTES = 1200  # UDP payload; QUIC asks no more of a path (RFC 9000, 14)
MESSAGE_OVERHEAD_BYTES = _HEAD_BYTES + 16
MEDIA_OVERHEAD_BYTES = 16
_VERSION = 2  # of RTP and RTCP
_SHORTEST_PACKET_BYTES = 8
_LONGEST_PACKET_BYTES = 1500  # pylibsrtp's buffer
LONGEST_PLAIN_BYTES = _LONGEST_PACKET_BYTES - 144  # it keeps room for any trailer
_REPLAY_WINDOW = 1024  # packets; a view sends some hundred a second


class MessageSealer:
    """Makes datagrams of messages: a kind byte, the counter, what is encrypted."""

    def __init__(self, key: bytes, kind: int) -> None:
        self._cipher = ChaCha20Poly1305(key)
        self._kind = bytes((kind,))
        self._counter = 0

    def seal(self, message: bytes) -> bytes:
        """The datagram of the next message."""
        self._counter += 1
        counter = _COUNTER.pack(self._counter)
        head = self._kind + counter
        return head + self._cipher.encrypt(_nonce(counter), message, head)


class MessageOpener:
    """Gets messages back. The newest counts: what is no newer than one before is refused."""

    def __init__(self, key: bytes) -> None:
        self._cipher = ChaCha20Poly1305(key)
        self._newest = 0
        self.late = 0  # repeated, or overtaken by a newer one

    def open(self, datagram: bytes) -> bytes | None:
        """The message; None if it is not authentic, or not newer than the newest."""
        if len(datagram) < MESSAGE_OVERHEAD_BYTES:
            return None
        head, counter = datagram[:_HEAD_BYTES], datagram[1:_HEAD_BYTES]
        try:
            message = self._cipher.decrypt(_nonce(counter), datagram[_HEAD_BYTES:], head)
        except InvalidTag:
            return None
        (number,) = _COUNTER.unpack(counter)
        if number <= self._newest:
            self.late += 1
            return None
        self._newest = number
        return message


class Media:
    """SRTP and SRTCP of one session, both directions; all streams of a direction share its key."""

    def __init__(self, keys: SessionKeys) -> None:
        self._out = _srtp(keys.send, Policy.SSRC_ANY_OUTBOUND)
        self._in = _srtp(keys.receive, Policy.SSRC_ANY_INBOUND)

    def protect(self, packet: bytes) -> bytes | None:
        """An RTP or RTCP packet as it is sent; None if it is neither, or longer than 1356 bytes."""
        protect = self._out.protect_rtcp if is_rtcp(packet) else self._out.protect
        return _unless_refused(protect, packet, LONGEST_PLAIN_BYTES)

    def unprotect(self, packet: bytes) -> bytes | None:
        """The RTP or RTCP packet; None if it is not authentic, or was received before."""
        unprotect = self._in.unprotect_rtcp if is_rtcp(packet) else self._in.unprotect
        return _unless_refused(unprotect, packet, _LONGEST_PACKET_BYTES)


def is_rtcp(packet: bytes) -> bool:
    """Whether it is RTCP where both share a port (RFC 5761, 4)."""
    return len(packet) > 1 and 192 <= packet[1] <= 223


def _unless_refused(
    convert: Callable[[bytes], bytes], packet: bytes, longest_bytes: int
) -> bytes | None:
    if not _SHORTEST_PACKET_BYTES <= len(packet) <= longest_bytes or packet[0] >> 6 != _VERSION:
        return None
    try:
        return convert(packet)
    except Error:
        return None


def _nonce(counter: bytes) -> bytes:
    return b"\0\0\0\0" + counter


def _srtp(keys: DirectionKeys, streams: int) -> Session:
    policy = Policy(
        key=keys.media, ssrc_type=streams, srtp_profile=Policy.SRTP_PROFILE_AEAD_AES_256_GCM
    )
    policy.window_size = _REPLAY_WINDOW
    policy.allow_repeat_tx = False
    return Session(policy)
