"""The datagrams of the handshake, and the keys that it ends with.

    operator's side                       robot's side
    INITIATION, no cookie      ─────►
                               ◄─────     COOKIE: of this address, now; nothing is kept
    INITIATION, with it        ─────►
                               ◄─────     RESPONSE, or BUSY

As in WireGuard, the last field of each datagram is a MAC under a key that the shared secret gives:
what a stranger made costs a comparison and a hash, and is not answered. The answers' MACs cover the
initiation's, so that none fits another initiation. An initiation is as long as the longest answer.
What carries the keys is Noise NNpsk0 (`noise`), in INITIATION and RESPONSE.
"""

from __future__ import annotations

import hmac
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import blake2b
from typing import Final

from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDFExpand

from tams_app.link.keys import IDENTITY_BYTES, Key
from tams_app.link.noise import OVERHEAD_BYTES, Split
from tams_app.units import NS_PER_S

# No kind byte of protocol 1 (0xC1 to 0xC4): a peer of that version is not answered.
INITIATION, COOKIE, BUSY, RESPONSE = 0xC5, 0xC6, 0xC7, 0xC8
PROLOGUE = b"TAMS link 2"
REKEY_PROLOGUE = b"TAMS link 2, new keys"
EPHEMERAL_BYTES = 32
TAG_BYTES = 8  # of an attempt, chosen by who begins it: tells what an answer is to
COOKIE_BYTES = 16
MAC_BYTES = 16
NO_COOKIE = bytes(COOKIE_BYTES)
INITIATION_BYTES = 1200  # UDP payload; QUIC asks no more of a path (RFC 9000, 14)
MESSAGE_KEY_BYTES = 32
MEDIA_KEY_BYTES = 32 + 12  # AES-256-GCM's key and salt (RFC 7714)
_COOKIE_NS = 5 * NS_PER_S  # a cookie is valid for five to ten seconds
_HEAD_BYTES = 1 + TAG_BYTES
_COOKIE_AT = _HEAD_BYTES + IDENTITY_BYTES
_NOISE_AT = _COOKIE_AT + COOKIE_BYTES
PADDING_BYTES = INITIATION_BYTES - _NOISE_AT - OVERHEAD_BYTES - MAC_BYTES


@dataclass(frozen=True, slots=True)
class DirectionKeys:
    """What one direction is protected by."""

    messages: bytes  # shape (32,)
    media: bytes  # shape (44,): key and salt


@dataclass(frozen=True, slots=True)
class SessionKeys:
    """Fresh keys of one handshake; what is sent by one side is received by the other."""

    number: bytes  # shape (4,): which of a link's sessions a message is of
    send: DirectionKeys
    receive: DirectionKeys


def session_keys(split: Split, initiator: bool) -> SessionKeys:
    """Noise's two keys are not used themselves: each becomes one for each purpose."""
    ours, theirs = split.initiator, split.responder
    if not initiator:
        ours, theirs = theirs, ours
    number = _derived(split.handshake_hash, b"TAMS session", 4)
    return SessionKeys(number, _direction(ours), _direction(theirs))


def _direction(key: bytes) -> DirectionKeys:
    return DirectionKeys(
        _derived(key, b"TAMS messages", MESSAGE_KEY_BYTES),
        _derived(key, b"TAMS media", MEDIA_KEY_BYTES),
    )


def _derived(key: bytes, purpose: bytes, length: int) -> bytes:
    return HKDFExpand(SHA256(), length, purpose).derive(key)


@dataclass(frozen=True, slots=True)
class Initiation:
    """What a key of ours has made: an initiation, now or recorded."""

    tag: bytes
    key: Key
    cookie: bytes
    noise: bytes
    mac: bytes


def initiation(key: Key, tag: bytes, cookie: bytes, noise: bytes) -> bytes:
    """The datagram that begins a handshake; `noise`: its first message, with `PADDING_BYTES`."""
    body = bytes((INITIATION,)) + tag + key.identity + cookie + noise
    return body + _mac(key, body)


def read_initiation(datagram: bytes, keys: Mapping[bytes, Key]) -> Initiation | None:
    """An initiation that one of `keys`, by identity, has made; None for all else."""
    if len(datagram) != INITIATION_BYTES:
        return None
    key = keys.get(datagram[_HEAD_BYTES:_COOKIE_AT])
    body, mac = datagram[:-MAC_BYTES], datagram[-MAC_BYTES:]
    if key is None or not hmac.compare_digest(mac, _mac(key, body)):
        return None
    return Initiation(body[1:_HEAD_BYTES], key, body[_COOKIE_AT:_NOISE_AT], body[_NOISE_AT:], mac)


def names_no_key(datagram: bytes, keys: Mapping[bytes, Key]) -> bool:
    """Whether it looks like an initiation of a key that is none of `keys`."""
    return len(datagram) == INITIATION_BYTES and datagram[_HEAD_BYTES:_COOKIE_AT] not in keys


def filled(content: bytes, size: int) -> bytes:
    """Content in `size` bytes, its length before it; longer content takes what it takes."""
    return (len(content).to_bytes(2) + content).ljust(size, b"\0")


def unfilled(content: bytes) -> bytes:
    """What was filled up; cut if it is shorter than it says."""
    return content[2 : 2 + int.from_bytes(content[:2])]


def answer(kind: int, tag: bytes, key: Key, initiation_mac: bytes, content: bytes) -> bytes:
    """A datagram that answers an initiation with this MAC."""
    body = bytes((kind,)) + tag + content
    return body + _mac(key, initiation_mac + body)


def read_answer(datagram: bytes, tag: bytes, key: Key, initiation_mac: bytes) -> bytes | None:
    """The content of an answer to the initiation with this tag and MAC; None for all else."""
    body, mac = datagram[:-MAC_BYTES], datagram[-MAC_BYTES:]
    if body[1:_HEAD_BYTES] != tag:
        return None
    if not hmac.compare_digest(mac, _mac(key, initiation_mac + body)):
        return None
    return body[_HEAD_BYTES:]


class Cookies:
    """Proofs that who sends from an address also receives there; nothing is kept of any."""

    def __init__(self, secret: bytes) -> None:
        self._secret: Final = secret

    def of(self, address: object, now_ns: int) -> bytes:
        """The cookie of an address, now."""
        return self._cookie(address, now_ns // _COOKIE_NS)

    def is_valid(self, cookie: bytes, address: object, now_ns: int) -> bool:
        """Whether it was given to this address five to ten seconds ago at most."""
        period = now_ns // _COOKIE_NS
        return any(
            hmac.compare_digest(cookie, self._cookie(address, one)) for one in (period, period - 1)
        )

    def _cookie(self, address: object, period: int) -> bytes:
        said = f"{period} {address!r}".encode()
        return blake2b(said, key=self._secret, digest_size=COOKIE_BYTES).digest()


def _mac(key: Key, body: bytes) -> bytes:
    return blake2b(body, key=key.mac_key, digest_size=MAC_BYTES).digest()
