"""Framing of the control connection: `u16 transaction, u16 protocol, u16 length, u8 register, ...`.

Big-endian throughout (uxbus_cmd_tcp.py of the SDK). The length counts the register and what
follows; a reply has a status byte between the register and its data.
"""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import dataclass

_HEADER = struct.Struct(">HHH")
_HEARTBEAT_PROTOCOL = 1
_PROTOCOLS = (_HEARTBEAT_PROTOCOL, 2, 3)  # 3: as 2, from clients that keep the line alive
_MAX_LENGTH = 1024


class MalformedFrameError(Exception):
    """The peer does not speak this protocol."""


@dataclass(frozen=True, slots=True)
class Frame:
    """One request."""

    transaction: int
    protocol: int
    register: int
    payload: bytes

    @property
    def is_heartbeat(self) -> bool:
        """Whether it only keeps the line alive and wants no answer."""
        return self.protocol == _HEARTBEAT_PROTOCOL

    def reply(self, status_and_data: bytes) -> bytes:
        """The bytes that answer this request."""
        header = _HEADER.pack(self.transaction, self.protocol, len(status_and_data) + 1)
        return header + bytes([self.register]) + status_and_data


class FrameReader:
    """Cuts a byte stream into frames."""

    def __init__(self) -> None:
        self._buffer = bytearray()

    def feed(self, received: bytes) -> Iterator[Frame]:
        """The frames that `received` completes; MalformedFrameError ends the stream."""
        self._buffer += received
        while len(self._buffer) >= _HEADER.size:
            transaction, protocol, length = _HEADER.unpack_from(self._buffer)
            if protocol not in _PROTOCOLS or not 1 <= length <= _MAX_LENGTH:
                raise MalformedFrameError(f"protocol {protocol}, length {length}")
            end = _HEADER.size + length
            if len(self._buffer) < end:
                return
            body = bytes(self._buffer[_HEADER.size : end])
            del self._buffer[:end]
            yield Frame(transaction, protocol, body[0], body[1:])
