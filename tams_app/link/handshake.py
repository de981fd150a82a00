"""The handshake: both sides prove that they hold the key, and agree on fresh session keys.

Noise_NNpsk0_25519_ChaChaPoly_SHA256 (the Noise protocol framework, revision 34): the shared secret
authenticates both, and an ephemeral Diffie-Hellman exchange keeps what was recorded secret even if
the secret is lost later. Two datagrams: `Dialer.hello`, then the answer to it.
"""

from __future__ import annotations

from dataclasses import dataclass

from cryptography.exceptions import InvalidTag
from cryptography.hazmat.primitives.hashes import SHA256
from cryptography.hazmat.primitives.kdf.hkdf import HKDFExpand
from noise.connection import NoiseConnection
from noise.exceptions import NoiseInvalidMessage, NoiseValueError

from tams_app.errors import TamsError

_PATTERN = b"Noise_NNpsk0_25519_ChaChaPoly_SHA256"
_PROLOGUE = b"TAMS link 1"
MESSAGE_KEY_BYTES = 32
MEDIA_KEY_BYTES = 32 + 12  # AES-256-GCM's key and salt (RFC 7714)
_NOT_OURS = (InvalidTag, NoiseInvalidMessage, NoiseValueError, ValueError)


class HandshakeError(TamsError):
    """A datagram of the handshake that the other side's key did not make."""


@dataclass(frozen=True, slots=True)
class DirectionKeys:
    """What one direction is protected by."""

    messages: bytes  # shape (32,)
    media: bytes  # shape (44,): key and salt


@dataclass(frozen=True, slots=True)
class SessionKeys:
    """Fresh keys of one session; what is sent by one side is received by the other."""

    send: DirectionKeys
    receive: DirectionKeys


class Dialer:
    """The side that begins; one object for each attempt."""

    def __init__(self, key: bytes, greeting: bytes) -> None:
        self._noise = _connection(key)
        self._noise.set_as_initiator()
        self._noise.start_handshake()
        self.hello = bytes(self._noise.write_message(greeting))

    def finish(self, answer: bytes) -> tuple[bytes, SessionKeys]:
        """What the other side says, and the keys; HandshakeError if it does not hold our key.

        After an error the attempt is void: anyone who can send a wrong answer can end it.
        """
        try:
            said = bytes(self._noise.read_message(answer))
        except _NOT_OURS as error:
            raise HandshakeError("the answer was not made with our key") from error
        return said, _session_keys(self._noise)


class Answerer:
    """The side that is called; one object for each call."""

    def __init__(self, key: bytes, hello: bytes) -> None:
        """HandshakeError if the caller does not hold our key. `greeting`: what they say."""
        self._noise = _connection(key)
        self._noise.set_as_responder()
        self._noise.start_handshake()
        try:
            self.greeting = bytes(self._noise.read_message(hello))
        except _NOT_OURS as error:
            raise HandshakeError("the call was not made with our key") from error

    def answer(self, content: bytes) -> tuple[bytes, SessionKeys]:
        """The datagram that carries `content` to the caller, and the keys; once."""
        answer = bytes(self._noise.write_message(content))
        return answer, _session_keys(self._noise)


def _connection(key: bytes) -> NoiseConnection:
    noise = NoiseConnection.from_name(_PATTERN)
    noise.set_psks(key)
    noise.set_prologue(_PROLOGUE)
    return noise


def _session_keys(noise: NoiseConnection) -> SessionKeys:
    """Noise's two keys are not used themselves: each becomes one for each purpose."""
    protocol = noise.noise_protocol
    return SessionKeys(
        send=_direction(protocol.cipher_state_encrypt.k),
        receive=_direction(protocol.cipher_state_decrypt.k),
    )


def _direction(key: bytes) -> DirectionKeys:
    def derived(purpose: bytes, length: int) -> bytes:
        return HKDFExpand(SHA256(), length, purpose).derive(key)

    return DirectionKeys(
        derived(b"TAMS messages", MESSAGE_KEY_BYTES), derived(b"TAMS media", MEDIA_KEY_BYTES)
    )
