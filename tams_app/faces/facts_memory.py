"""The facts' way to the window: memory that both processes share, in which the newest wins."""

from __future__ import annotations

import mmap
import os
import struct

import msgspec

from tams_app.faces.messages import FaceFacts
from tams_app.faces.silence import as_known
from tams_app.runtime.shared_ring import (
    RingShape,
    SharedRing,
    create_block,
    map_descriptor,
    new_block_name,
    open_descriptor,
    remove_block,
)
from tams_app.units import NS_PER_MS

_AGAIN_NS = 100 * NS_PER_MS  # between two times of a silence that are shown
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
    """The facts that a face shows: each as it is put, and while nothing comes for how long.

    It reads the memory behind `descriptor`, which it closes.
    """

    def __init__(self, descriptor: int) -> None:
        self._memory: mmap.mmap = map_descriptor(descriptor)
        self._ring = SharedRing(self._memory, _SHAPE)
        self._read = 0
        self._newest: FaceFacts | None = None
        self._again_ns = 0  # when to show the duration of a silence anew

    def newer(self, now_ns: int) -> FaceFacts | None:
        """What is to be shown from now on; None: what is shown already."""
        newer = self._put_since()
        self._newest = newer or self._newest
        if self._newest is None:
            return None
        known = as_known(self._newest, now_ns)
        if newer is None and (known is self._newest or now_ns < self._again_ns):
            return None
        self._again_ns = now_ns + _AGAIN_NS
        return known

    def _put_since(self) -> FaceFacts | None:
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
