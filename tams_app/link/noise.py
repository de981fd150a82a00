"""Noise_NNpsk0_25519_ChaChaPoly_SHA256: two messages that prove a shared secret and agree on keys.

Of the Noise protocol framework, revision 34, this one pattern, over the primitives of the package
`cryptography`. The shared secret authenticates both sides, and an ephemeral Diffie-Hellman exchange
keeps what was recorded secret even if the shared secret is lost later. Nothing here draws random
numbers, and reading a message changes no state: what is wrong leaves everything as it was.
"""

from __future__ import annotations

import hmac
from dataclasses import dataclass
from hashlib import sha256

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.asymmetric.x25519 import X25519PrivateKey, X25519PublicKey
from cryptography.hazmat.primitives.ciphers.aead import ChaCha20Poly1305

from tams_app.errors import TamsError

_NAME = b"Noise_NNpsk0_25519_ChaChaPoly_SHA256"
PUBLIC_BYTES = 32
TAG_BYTES = 16
OVERHEAD_BYTES = PUBLIC_BYTES + TAG_BYTES  # of each of the two messages


class NoiseError(TamsError):
    """A message that the other side's secret did not make, or that is no answer to ours."""


@dataclass(frozen=True, slots=True)
class Split:
    """What a handshake ends with: a key for each direction, and the hash of all that was said."""

    initiator: bytes  # shape (32,): of what the initiator sends
    responder: bytes  # shape (32,)
    handshake_hash: bytes  # shape (32,)


@dataclass(frozen=True, slots=True)
class _State:
    """Noise's symmetric state (5.2); immutable, each step makes the next one.

    A key encrypts once: between two uses of the cipher this pattern always mixes in a new one.
    """

    chain: bytes
    hash: bytes
    key: bytes = b""

    def with_hash(self, data: bytes) -> _State:
        return _State(self.chain, sha256(self.hash + data).digest(), self.key)

    def with_key(self, material: bytes) -> _State:
        chain, key = _hkdf(self.chain, material, 2)
        return _State(chain, self.hash, key)

    def with_key_and_hash(self, material: bytes) -> _State:
        chain, hashed, key = _hkdf(self.chain, material, 3)
        return _State(chain, sha256(self.hash + hashed).digest(), key)

    def with_public(self, public: bytes) -> _State:
        """The token e; where a secret is shared, the public key is mixed into the key too (9.2)."""
        return self.with_hash(public).with_key(public)

    def sealed(self, payload: bytes) -> tuple[bytes, _State]:
        encrypted = ChaCha20Poly1305(self.key).encrypt(bytes(12), payload, self.hash)
        return encrypted, self.with_hash(encrypted)

    def opened(self, encrypted: bytes) -> tuple[bytes, _State]:
        try:
            payload = ChaCha20Poly1305(self.key).decrypt(bytes(12), encrypted, self.hash)
        except InvalidTag as error:
            raise NoiseError("a message of the handshake that our secret did not make") from error
        return payload, self.with_hash(encrypted)

    def split(self) -> Split:
        initiator, responder = _hkdf(self.chain, b"", 2)
        return Split(initiator, responder, self.hash)


class Initiator:
    """The side that begins. `message`: what it sends first."""

    def __init__(self, secret: bytes, prologue: bytes, ephemeral: bytes, payload: bytes) -> None:
        """`secret`: 32 bytes, shared; `ephemeral`: 32 random bytes, for this handshake alone."""
        self._ephemeral = X25519PrivateKey.from_private_bytes(ephemeral)
        public = self._ephemeral.public_key().public_bytes_raw()
        encrypted, self._state = _first(secret, prologue, public).sealed(payload)
        self.message = public + encrypted

    def finish(self, answer: bytes) -> tuple[bytes, Split]:
        """The answer's payload, and the keys; NoiseError if it is none, and then another may be."""
        public, encrypted = _parts(answer)
        shared = _exchange(self._ephemeral, public)
        payload, state = self._state.with_public(public).with_key(shared).opened(encrypted)
        return payload, state.split()


class Responder:
    """The side that answers. `payload`: what the first message carries."""

    def __init__(self, secret: bytes, prologue: bytes, message: bytes) -> None:
        """NoiseError if the secret did not make `message`."""
        self._public, encrypted = _parts(message)
        self.payload, self._state = _first(secret, prologue, self._public).opened(encrypted)

    def answer(self, ephemeral: bytes, payload: bytes) -> tuple[bytes, Split]:
        """The second message, and the keys; NoiseError for a public key of low order."""
        private = X25519PrivateKey.from_private_bytes(ephemeral)
        public = private.public_key().public_bytes_raw()
        shared = _exchange(private, self._public)
        encrypted, state = self._state.with_public(public).with_key(shared).sealed(payload)
        return public + encrypted, state.split()


def _first(secret: bytes, prologue: bytes, public: bytes) -> _State:
    """The state behind the tokens of the first message: psk, e."""
    name = sha256(_NAME).digest()  # longer than a hash: hashed (5.2)
    return _State(name, name).with_hash(prologue).with_key_and_hash(secret).with_public(public)


def _parts(message: bytes) -> tuple[bytes, bytes]:
    """Public key and encrypted payload of a message."""
    if len(message) < OVERHEAD_BYTES:
        raise NoiseError("too short to be a message of the handshake")
    return message[:PUBLIC_BYTES], message[PUBLIC_BYTES:]


def _exchange(private: X25519PrivateKey, public: bytes) -> bytes:
    try:
        return private.exchange(X25519PublicKey.from_public_bytes(public))
    except ValueError as error:  # the result is 0 for a point of low order
        raise NoiseError("a public key that leads to no secret") from error


def _hkdf(chain: bytes, material: bytes, outputs: int) -> list[bytes]:
    """Noise's HKDF (4.3), which is that of RFC 5869 without info."""
    extracted = hmac.digest(chain, material, "sha256")
    made: list[bytes] = []
    for number in range(1, outputs + 1):
        before = made[-1] if made else b""
        made.append(hmac.digest(extracted, before + bytes((number,)), "sha256"))
    return made
