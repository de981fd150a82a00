"""How the two sides prove to each other that they have one key, without saying it.

A caller's first packet carries a greeting, so that a stranger is not answered at all. Over the
connection's one stream follow, each with its length before it:

    robot's side     Challenge
    operator's side  Proof: who they are, and a MAC under the key
    robot's side     Welcome, with a MAC of its own; or Busy

Both MACs cover the robot's identity, the certificate of this connection and both sides' random
numbers: what was recorded, or is handed on by somebody between the two, proves nothing.
"""

from __future__ import annotations

import hmac
from collections.abc import Mapping
from dataclasses import dataclass
from hashlib import sha256
from typing import TypeAlias

import msgspec

from tams_app.link.identity import PUBLIC_BYTES
from tams_app.link.keys import IDENTITY_BYTES, Key

NONCE_BYTES = 32
GREETING_NONCE_BYTES = 16
LONGEST_INTRODUCTION_BYTES = 256
WELCOME_BYTES = 1127
_GREETING = b"\x01"
_MAC_BYTES = 16  # of a greeting
_ANSWER_BYTES = 16
_NONCE_AT = len(_GREETING) + IDENTITY_BYTES
_LONGEST_BYTES = 2000


class Challenge(msgspec.Struct, frozen=True, tag=True):
    """The robot's side asks who calls."""

    nonce: bytes


class Proof(msgspec.Struct, frozen=True, tag=True):
    """The operator's side says it. `introduction`: filled up, for the robot's application."""

    key: bytes
    nonce: bytes
    mac: bytes
    introduction: bytes


class Welcome(msgspec.Struct, frozen=True, tag=True):
    """They are in. `content`: filled up, for the operator's application."""

    content: bytes
    mac: bytes


class Busy(msgspec.Struct, frozen=True, tag=True):
    """Another operator is there."""


Word: TypeAlias = Challenge | Proof | Welcome | Busy
_DECODER = msgspec.msgpack.Decoder(Word)


def framed(word: Word) -> bytes:
    """The word as the stream carries it."""
    content = msgspec.msgpack.encode(word)
    return len(content).to_bytes(2) + content


class WordStream:
    """Gets words out of a stream."""

    def __init__(self) -> None:
        self._rest = b""
        self.ended = False  # what came is no word, and none follows

    def of(self, content: bytes) -> list[Word]:
        """The words that are whole with this."""
        words: list[Word] = []
        self._rest += content
        while not self.ended and len(self._rest) >= 2:
            end = 2 + int.from_bytes(self._rest[:2])
            if len(self._rest) < end <= _LONGEST_BYTES:
                break
            try:
                words.append(_DECODER.decode(self._rest[2:end]))
            except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
                self.ended = True
            self._rest = self._rest[end:]
        return words


@dataclass(frozen=True, slots=True)
class Meeting:
    """What both MACs of a connection are about."""

    key: Key
    certificate: bytes  # DER
    robots: bytes  # nonce, shape (32,)
    operators: bytes  # nonce, shape (32,)

    def proof(self, introduction: bytes) -> bytes:
        """The operator's MAC; shape (32,)."""
        return self._mac(b"TAMS operator", introduction)

    def welcome(self, content: bytes) -> bytes:
        """The robot's; shape (32,)."""
        return self._mac(b"TAMS robot", content)

    def _mac(self, label: bytes, content: bytes) -> bytes:
        robot = self.key.robot or bytes(PUBLIC_BYTES)  # without a key there is none to know
        certificate = sha256(self.certificate).digest()
        about = label + robot + certificate + self.robots + self.operators + content
        return hmac.digest(self.key.secret, about, sha256)


def greeting(key: Key, nonce: bytes) -> bytes:
    """The token of a first packet. `nonce`: random, shape (16,), for this call alone."""
    body = _GREETING + key.identity + nonce
    return body + _greeting_mac(key, body)


def read_greeting(token: bytes, keys: Mapping[bytes, Key]) -> Key | None:
    """The one of `keys`, by identity, that made it; None for all else."""
    key, body = keys.get(token[len(_GREETING) : _NONCE_AT]), token[:-_MAC_BYTES]
    if key is None or not _is_greeting(token):
        return None
    return key if hmac.compare_digest(token[-_MAC_BYTES:], _greeting_mac(key, body)) else None


def answer(key: Key, token: bytes) -> bytes:
    """What only who has the key can say to a Retry packet with this token; shape (16,)."""
    return hmac.digest(key.secret, b"TAMS answer" + token, sha256)[:_ANSWER_BYTES]


def split_answer(token: bytes) -> tuple[bytes, bytes]:
    """A Retry packet's token that came back, and the answer behind it."""
    return token[:-_ANSWER_BYTES], token[-_ANSWER_BYTES:]


def names_no_key(token: bytes, keys: Mapping[bytes, Key]) -> bool:
    """Whether it looks like a greeting with a key that is none of `keys`."""
    return _is_greeting(token) and token[len(_GREETING) : _NONCE_AT] not in keys


def _is_greeting(token: bytes) -> bool:
    whole = _NONCE_AT + GREETING_NONCE_BYTES + _MAC_BYTES
    return len(token) == whole and token.startswith(_GREETING)


def _greeting_mac(key: Key, body: bytes) -> bytes:
    return hmac.digest(key.secret, b"TAMS greeting" + body, sha256)[:_MAC_BYTES]


def filled(content: bytes, size: int) -> bytes:
    """Content in `size` bytes and its length before it; longer content is cut."""
    content = content[:size]
    return len(content).to_bytes(2) + content.ljust(size, b"\0")


def unfilled(content: bytes) -> bytes:
    """What was filled up; cut if it is shorter than it says."""
    return content[2 : 2 + int.from_bytes(content[:2])]
