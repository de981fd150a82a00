"""The facts' way to the window: memory that both processes share, in which the newest wins."""

from __future__ import annotations

import mmap
import os
import struct

import msgspec

from tams_app.faces.messages import FaceFacts
from tams_app.runtime.shared_ring import (
    RingShape,
    SharedRing,
    create_block,
    map_descriptor,
    new_block_name,
    open_descriptor,
    remove_block,
)

_LENGTH = struct.Struct("<I")
_SHAPE = RingShape(head_bytes=32 * 1024, heads=4)


class FactsWriter:
    """Puts facts; never waits. `descriptor` is what the reader's process maps."""

    def __init__(self) -> None:
        name = new_block_name()
        self._memory = create_block(name, _SHAPE.size)
        self.descriptor = open_descriptor(name)
        remove_block(name)
        self._ring = SharedRing(self._memory, _SHAPE)

    def put(self, facts: FaceFacts) -> None:
        """Put them in the place of the oldest; ValueError if they are too long."""
        content = msgspec.msgpack.encode(facts)
        head = _LENGTH.pack(len(content)) + content
        if len(head) > _SHAPE.head_bytes:
            raise ValueError(f"facts of {len(content)} bytes")
        self._ring.put(head.ljust(_SHAPE.head_bytes, b"\0"))

    def close(self) -> None:
        """Give the memory back; once."""
        os.close(self.descriptor)
        self._memory.close()


class FactsReader:
    """Reads the newest facts in the memory behind `descriptor`, which it closes."""

    def __init__(self, descriptor: int) -> None:
        self._memory: mmap.mmap = map_descriptor(descriptor)
        self._ring = SharedRing(self._memory, _SHAPE)
        self._read = 0

    def newer(self) -> FaceFacts | None:
        """The newest facts; None if they were read already, or none are whole."""
        if self._ring.written() == self._read:
            return None
        found = self._ring.newest()
        if found is None:
            return None
        number, head = found
        self._read = number + 1
        (length,) = _LENGTH.unpack_from(head)
        return msgspec.msgpack.decode(head[_LENGTH.size : _LENGTH.size + length], type=FaceFacts)
