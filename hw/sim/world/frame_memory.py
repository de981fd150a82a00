"""Rings of frames in shared memory, one per view: the renderer writes, cameras read.

Per slot a serial number that is odd while its frame is being written. A ring holds SLOTS
frames, so a reader has SLOTS - 1 periods to copy one before it is overwritten, and the serial
number, read again after the copy, tells if it was.
"""

from __future__ import annotations

import mmap
import struct
from dataclasses import dataclass

import numpy as np

from hw.sim.world.shared_block import attach_block, create_block
from tams_app.records import Frame, Image

SLOTS = 4
_RING = struct.Struct("<QqqQ")  # frames written, grid start [ns], period [ns], frames skipped
_SLOT = struct.Struct("<Qqq")  # serial, index, capture [ns]
_RING_HEADER_BYTES = 64
_SLOT_HEADER_BYTES = 64


@dataclass(frozen=True, slots=True)
class FrameShape:
    """The views and the size of their frames; writer and readers must agree on it."""

    views: tuple[str, ...] = ("eih", "gt", "gs")
    width: int = 640
    height: int = 480

    @property
    def frame_bytes(self) -> int:
        return self.width * self.height * 3

    @property
    def ring_bytes(self) -> int:
        return _RING_HEADER_BYTES + SLOTS * (_SLOT_HEADER_BYTES + self.frame_bytes)

    def ring_start(self, view: str) -> int:
        return self.views.index(view) * self.ring_bytes


@dataclass(frozen=True, slots=True)
class FrameGrid:
    """Frame n of a view is due at `start_ns + n * period_ns`; 0 before the first."""

    start_ns: int
    period_ns: int


class FrameWriter:
    """Publishes frames under `memory_name`; one writer at a time."""

    def __init__(self, memory_name: str, shape: FrameShape) -> None:
        self._shape = shape
        size = len(shape.views) * shape.ring_bytes
        self._block = create_block(f"{memory_name}-frames", size)

    def grid(self, view: str) -> FrameGrid:
        """The grid left by an earlier writer, `start_ns` 0 if there was none."""
        _, start_ns, period_ns, _ = _read_ring(self._block, self._shape.ring_start(view))
        return FrameGrid(start_ns, period_ns)

    def set_grid(self, view: str, grid: FrameGrid) -> None:
        """Tell the readers when to expect frames."""
        start = self._shape.ring_start(view)
        written, _, _, skipped = _read_ring(self._block, start)
        _RING.pack_into(self._block, start, written, grid.start_ns, grid.period_ns, skipped)

    def publish(self, view: str, index: int, capture_ns: int, image: Image, skipped: int) -> None:
        """Put a BGR frame, shape (height, width, 3), in the ring; `skipped` so far in all."""
        block, shape = self._block, self._shape
        ring = shape.ring_start(view)
        written, start_ns, period_ns, _ = _read_ring(block, ring)
        slot = _slot_start(shape, ring, written)
        _SLOT.pack_into(block, slot, 2 * written + 1, index, capture_ns)
        pixels = slot + _SLOT_HEADER_BYTES
        block[pixels : pixels + shape.frame_bytes] = image.data.cast("B")
        _SLOT.pack_into(block, slot, 2 * written + 2, index, capture_ns)
        _RING.pack_into(block, ring, written + 1, start_ns, period_ns, skipped)

    def close(self) -> None:
        self._block.close()


class FrameReader:
    """Reads one view's ring under `memory_name`; DeviceError when the renderer never started."""

    def __init__(self, memory_name: str, view: str, shape: FrameShape) -> None:
        self._shape = shape
        self._view = view
        self._block = attach_block(f"{memory_name}-frames", len(shape.views) * shape.ring_bytes)
        self._ring = shape.ring_start(view)

    def written(self) -> int:
        """How many frames were put so far."""
        return _read_ring(self._block, self._ring)[0]

    def skipped(self) -> int:
        """How many frames the renderer left out because it was behind."""
        return _read_ring(self._block, self._ring)[3]

    def grid(self) -> FrameGrid:
        _, start_ns, period_ns, _ = _read_ring(self._block, self._ring)
        return FrameGrid(start_ns, period_ns)

    def newest(self) -> Frame | None:
        """A copy of the newest frame; None before the first or if it was overwritten."""
        shape = self._shape
        written = self.written()
        if written == 0:
            return None
        slot = _slot_start(shape, self._ring, written - 1)
        serial, index, capture_ns = _SLOT.unpack_from(self._block, slot)
        pixels = slot + _SLOT_HEADER_BYTES
        source = np.frombuffer(self._block, np.uint8, shape.frame_bytes, pixels)
        image = source.reshape(shape.height, shape.width, 3).copy()
        if serial != 2 * written or _SLOT.unpack_from(self._block, slot)[0] != serial:
            return None
        return Frame(self._view, index, capture_ns, image)

    def close(self) -> None:
        self._block.close()


def _read_ring(block: mmap.mmap, start: int) -> tuple[int, int, int, int]:
    written, start_ns, period_ns, skipped = _RING.unpack_from(block, start)
    return written, start_ns, period_ns, skipped


def _slot_start(shape: FrameShape, ring: int, number: int) -> int:
    return ring + _RING_HEADER_BYTES + number % SLOTS * (_SLOT_HEADER_BYTES + shape.frame_bytes)
