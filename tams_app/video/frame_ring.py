"""Rings through which the SSIM helper gets the captured and the shown frames.

One ring per view and kind. Index and time of the last ENTRIES frames are kept, the luma of the last
LUMAS: a reader that falls behind learns of every frame, though it may miss what it looked like.
"""

from __future__ import annotations

import mmap
import struct
from dataclasses import dataclass

import cv2

from tams_app.records import Image
from tams_app.runtime.shared_ring import RingShape, SharedRing
from tams_app.video.ssim import Luma

LUMAS = 16  # half a second
ENTRIES = 1024  # half a minute
_ENTRY = struct.Struct("<qq")  # index, time [ns]
CAPTURED, SHOWN = "captured", "shown"
KINDS = (CAPTURED, SHOWN)


@dataclass(frozen=True, slots=True)
class RingLayout:
    """The views and the size of their frames [px]; writers and readers must agree on it."""

    views: tuple[str, ...]
    width: int
    height: int

    @property
    def ring_shape(self) -> RingShape:
        return RingShape(_ENTRY.size, ENTRIES, self.width * self.height, LUMAS)

    @property
    def block_bytes(self) -> int:
        return len(self.views) * len(KINDS) * self.ring_shape.size

    def ring(self, block: mmap.mmap, view: str, kind: str) -> SharedRing:
        """The ring of `view` and `kind` within `block`."""
        place = self.views.index(view) * len(KINDS) + KINDS.index(kind)
        return SharedRing(block, self.ring_shape, place * self.ring_shape.size)


@dataclass(frozen=True, slots=True)
class RingEntry:
    """One frame that was put; `luma` is None if it was overwritten before it was read."""

    index: int
    t_ns: int
    luma: Luma | None


class FrameWriter:
    """Puts the frames of one view and kind into a block; from one thread."""

    def __init__(self, block: mmap.mmap, layout: RingLayout, view: str, kind: str) -> None:
        self._ring = layout.ring(block, view, kind)
        self._shape = (layout.height, layout.width, 3)

    def put(self, index: int, t_ns: int, image: Image) -> None:
        """Put a BGR image, shape (height, width, 3); ValueError for another size."""
        if image.shape != self._shape:
            raise ValueError(f"expected a frame of shape {self._shape}, got {image.shape}")
        self._ring.put(
            _ENTRY.pack(index, t_ns),
            lambda luma: cv2.cvtColor(image, cv2.COLOR_BGR2GRAY, dst=luma.reshape(self._shape[:2])),
        )


class FrameReader:
    """Reads one ring from its beginning."""

    def __init__(self, block: mmap.mmap, layout: RingLayout, view: str, kind: str) -> None:
        self._ring = layout.ring(block, view, kind)
        self._luma_shape = (layout.height, layout.width)
        self._next = 0

    def written(self) -> int:
        """How many frames were put so far."""
        return self._ring.written()

    def read(self, until: int) -> list[RingEntry]:
        """Copies of the frames not read yet, up to the first `until` that were ever put."""
        oldest = self.written() - ENTRIES + 1  # the one before it may be overwritten right now
        self._next = max(self._next, oldest)
        entries = []
        for number in range(self._next, until):
            head, luma = self._ring.head(number), self._ring.bulk(number)
            if head is None:  # overwritten while the ones before it were read
                continue
            index, t_ns = _ENTRY.unpack(head)
            image = None if luma is None else luma.reshape(self._luma_shape)
            entries.append(RingEntry(index, t_ns, image))
        self._next = max(self._next, until)
        return entries
