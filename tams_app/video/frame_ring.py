"""Captured and shown frames on their way to who compares them: rings in shared memory.

One ring per view and kind; one writer each, which never waits. Index and time of the last ENTRIES
frames are kept, the lumas of the last PICTURES: a reader that falls behind learns of every
frame though it may miss what it looked like. Per luma a serial number that is odd while it is
being written and tells, read again after the copy, if it was overwritten meanwhile.
"""

from __future__ import annotations

import mmap
import struct
from dataclasses import dataclass

import cv2
import numpy as np

from tams_app.records import Image
from tams_app.video.ssim import Luma

PICTURES = 16  # half a second
ENTRIES = 1024  # half a minute
_WRITTEN = struct.Struct("<Q")
_ENTRY = struct.Struct("<qq")  # index, time [ns]
_SERIAL = struct.Struct("<Q")
_HEADER_BYTES = 64
CAPTURED, SHOWN = "captured", "shown"
KINDS = (CAPTURED, SHOWN)


@dataclass(frozen=True, slots=True)
class RingLayout:
    """The views and the size of their frames; writers and readers must agree on it."""

    views: tuple[str, ...]
    width: int
    height: int

    @property
    def luma_bytes(self) -> int:
        return self.width * self.height

    @property
    def lumas_start(self) -> int:
        """Within a ring: behind the counter, the entries and the serials of the lumas."""
        used = _HEADER_BYTES + ENTRIES * _ENTRY.size + PICTURES * _SERIAL.size
        return -(-used // _HEADER_BYTES) * _HEADER_BYTES

    @property
    def ring_bytes(self) -> int:
        whole = self.lumas_start + PICTURES * self.luma_bytes
        return -(-whole // _HEADER_BYTES) * _HEADER_BYTES

    @property
    def block_bytes(self) -> int:
        return len(self.views) * len(KINDS) * self.ring_bytes

    def ring_start(self, view: str, kind: str) -> int:
        place = self.views.index(view) * len(KINDS) + KINDS.index(kind)
        return place * self.ring_bytes


@dataclass(frozen=True, slots=True)
class RingEntry:
    """One frame that was put; `luma` is None if it was overwritten before it was read."""

    index: int
    t_ns: int
    luma: Luma | None


class FrameWriter:
    """Puts the frames of one view and kind into a block; from one thread."""

    def __init__(self, block: mmap.mmap, layout: RingLayout, view: str, kind: str) -> None:
        self._block = block
        self._start = layout.ring_start(view, kind)
        self._lumas = _lumas(block, layout, self._start)
        self._shape = (layout.height, layout.width, 3)
        self._written = 0

    def put(self, index: int, t_ns: int, image: Image) -> None:
        """Put a BGR frame, shape (height, width, 3); ValueError for another size."""
        if image.shape != self._shape:
            raise ValueError(f"expected a frame of shape {self._shape}, got {image.shape}")
        number = self._written
        serial_at = _serial_at(self._start, number)
        _SERIAL.pack_into(self._block, serial_at, 2 * number + 1)
        cv2.cvtColor(image, cv2.COLOR_BGR2GRAY, dst=self._lumas[number % PICTURES])
        _SERIAL.pack_into(self._block, serial_at, 2 * number + 2)
        _ENTRY.pack_into(self._block, _entry_at(self._start, number), index, t_ns)
        self._written = number + 1
        _WRITTEN.pack_into(self._block, self._start, self._written)

    def release(self) -> None:
        """Let go of the block, so that it can be closed."""
        self._lumas = []


class FrameReader:
    """Reads one ring from its beginning; `missed` counts the frames it never learned of."""

    def __init__(self, block: mmap.mmap, layout: RingLayout, view: str, kind: str) -> None:
        self.missed = 0
        self._block = block
        self._start = layout.ring_start(view, kind)
        self._lumas = _lumas(block, layout, self._start)
        self._next = 0

    def written(self) -> int:
        """How many frames were put so far."""
        return int(_WRITTEN.unpack_from(self._block, self._start)[0])

    def read(self, until: int) -> list[RingEntry]:
        """Copies of the frames not read yet, up to the first `until` that were ever put."""
        oldest = self.written() - ENTRIES + 1  # the one before it may be overwritten right now
        if self._next < oldest:
            self.missed += oldest - self._next
            self._next = oldest
        entries = [self._entry(number) for number in range(self._next, until)]
        self._next = max(self._next, until)
        return entries

    def release(self) -> None:
        """Let go of the block, so that it can be closed."""
        self._lumas = []

    def _entry(self, number: int) -> RingEntry:
        index, t_ns = _ENTRY.unpack_from(self._block, _entry_at(self._start, number))
        return RingEntry(index, t_ns, self._luma(number))

    def _luma(self, number: int) -> Luma | None:
        serial, at = 2 * number + 2, _serial_at(self._start, number)
        if _SERIAL.unpack_from(self._block, at)[0] != serial:
            return None
        luma = self._lumas[number % PICTURES].copy()
        return luma if _SERIAL.unpack_from(self._block, at)[0] == serial else None


def _lumas(block: mmap.mmap, layout: RingLayout, start: int) -> list[Luma]:
    """The places of a ring's lumas, shape (height, width) each."""
    first = start + layout.lumas_start
    return [
        np.frombuffer(
            block, np.uint8, layout.luma_bytes, first + place * layout.luma_bytes
        ).reshape(layout.height, layout.width)
        for place in range(PICTURES)
    ]


def _entry_at(start: int, number: int) -> int:
    return start + _HEADER_BYTES + number % ENTRIES * _ENTRY.size


def _serial_at(start: int, number: int) -> int:
    return start + _HEADER_BYTES + ENTRIES * _ENTRY.size + number % PICTURES * _SERIAL.size
