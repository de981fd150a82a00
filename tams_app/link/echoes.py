"""Echoes, by which `doctor --link` measures a link; the gateway answers them by itself."""

from __future__ import annotations

import struct

PREFIX = b"\0"  # of all that the gateways send each other; applications' messages begin otherwise
_PING, _PONG = b"\0ping", b"\0pong"
_NUMBER = struct.Struct("!I")


def ping(number: int) -> bytes:
    """A message that is answered at once."""
    return _PING + _NUMBER.pack(number)


def answer(message: bytes) -> bytes | None:
    """The answer to a ping; None to anything else."""
    return _PONG + message[len(_PING) :] if message.startswith(_PING) else None


def number_of(message: bytes) -> int | None:
    """The number of the ping that is answered; None if it is no such answer."""
    if not message.startswith(_PONG) or len(message) != len(_PONG) + _NUMBER.size:
        return None
    return int(_NUMBER.unpack_from(message, len(_PONG))[0])
