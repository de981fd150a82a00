"""What is sent between the two computers, encrypted and authenticated.

Messages: ChaCha20-Poly1305 (RFC 8439) with a counter, filled up to one of a few sizes. Video and
its feedback: SRTP and SRTCP (RFC 3711) with AES-256-GCM (RFC 7714), by libsrtp.
"""

from __future__ import annotations

import struct
from collections.abc import Callable

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305
from pylibsrtp import Error, Policy, Session

from tams_app.link.handshake import DirectionKeys, SessionKeys

_NUMBER_BYTES = 4  # of the session
_COUNTER = struct.Struct("!Q")
_HEAD_BYTES = 1 + _NUMBER_BYTES + _COUNTER.size
_END = b"\x80"  # of a message, before what fills it up (as ISO/IEC 9797-1 has it)
LONGEST_DATAGRAM_BYTES = 1200  # UDP payload; QUIC asks no more of a path (RFC 9000, 14)
_OVERHEAD_BYTES = _HEAD_BYTES + 16
LONGEST_MESSAGE_BYTES = LONGEST_DATAGRAM_BYTES - _OVERHEAD_BYTES - len(_END)
# What a message is filled up to, so that its length does not tell what arm or operator do:
LINK_BYTES = 64  # messages of the link itself
HAND_BYTES = 256  # a sample of the hand
STATE_BYTES = 512  # a state of the robot with its longest reason
_SIZES = (LINK_BYTES, HAND_BYTES, STATE_BYTES, LONGEST_MESSAGE_BYTES + len(_END))
MEDIA_OVERHEAD_BYTES = 16
_VERSION = 2  # of RTP and RTCP
_SHORTEST_PACKET_BYTES = 8
_LONGEST_PACKET_BYTES = 1500  # pylibsrtp's buffer
LONGEST_PLAIN_BYTES = _LONGEST_PACKET_BYTES - 144  # it keeps room for any trailer
_REPLAY_WINDOW = 1024  # packets; a view sends some hundred a second


def sealed_bytes(message_bytes: int, least_bytes: int = LINK_BYTES) -> int:
    """UDP payload of the datagram of a message with so many bytes, filled up to `least_bytes`."""
    whole = max(message_bytes + len(_END), least_bytes)
    return _OVERHEAD_BYTES + next((size for size in _SIZES if size >= whole), whole)


def session_number(datagram: bytes) -> bytes:
    """Which session a message says that it is of."""
    return datagram[1 : 1 + _NUMBER_BYTES]


class MessageSealer:
    """Makes datagrams of messages: a kind byte, the session, the counter, what is encrypted."""

    def __init__(self, key: bytes, kind: int, number: bytes) -> None:
        self._cipher = ChaCha20Poly1305(key)
        self._head = bytes((kind,)) + number
        self._counter = 0

    def seal(self, message: bytes, least_bytes: int = LINK_BYTES) -> bytes:
        """The datagram of the next message, filled up to a size of `least_bytes` or more."""
        self._counter += 1
        counter = _COUNTER.pack(self._counter)
        head = self._head + counter
        size_bytes = sealed_bytes(len(message), least_bytes) - _OVERHEAD_BYTES
        whole = (message + _END).ljust(size_bytes, b"\0")
        return head + self._cipher.encrypt(_nonce(counter), whole, head)


class MessageOpener:
    """Gets messages back. The newest counts: what is no newer than one before is refused."""

    def __init__(self, key: bytes) -> None:
        self._cipher = ChaCha20Poly1305(key)
        self._newest = 0
        self.late = 0  # repeated, or overtaken by a newer one

    def open(self, datagram: bytes) -> bytes | None:
        """The message; None if it is not authentic, or not newer than the newest."""
        if len(datagram) <= _OVERHEAD_BYTES:
            return None
        head, counter = datagram[:_HEAD_BYTES], datagram[_HEAD_BYTES - _COUNTER.size : _HEAD_BYTES]
        try:
            whole = self._cipher.decrypt(_nonce(counter), datagram[_HEAD_BYTES:], head)
        except InvalidTag:
            return None
        (number,) = _COUNTER.unpack(counter)
        if number <= self._newest:
            self.late += 1
            return None
        self._newest = number
        return whole.rstrip(b"\0")[: -len(_END)]


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


def ssrc_of(packet: bytes) -> int:
    """The stream that an RTP packet is of, or an RTCP packet's sender; 0 if it is too short."""
    return int.from_bytes(packet[4:8] if is_rtcp(packet) else packet[8:12])


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
