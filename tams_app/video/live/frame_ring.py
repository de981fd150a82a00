"""Rings through which other processes get the captured and the shown frames.

One block of memory per kind, in it one ring per view. Captured frames are kept as luma, for the
SSIM helper alone; shown ones in colour, since the seeing operator looks at them too: copying is
cheaper than making luma, which is left to the SSIM helper. Index, times and the task's region of
the last ENTRIES frames are kept, the pixels of the last IMAGES: a reader that falls behind learns
of every frame, though it may miss what it looked like.
"""

from __future__ import annotations

import math
import mmap
import os
import struct
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial

import cv2
import numpy as np

from tams_app.records import Image, TaskRegion
from tams_app.runtime.shared_ring import (
    Bulk,
    RingShape,
    SharedRing,
    create_block,
    new_block_name,
    open_descriptor,
    remove_block,
)
from tams_app.video.core.ssim import Luma

IMAGES = 16  # half a second
ENTRIES = 1024  # half a minute
# index, when it was put and when captured [ns], the task's region [px]: nan where there is none
_ENTRY = struct.Struct("<qqqddd")
_NO_REGION = (math.nan,) * 3
CAPTURED, SHOWN = "captured", "shown"
_CHANNELS = {CAPTURED: 1, SHOWN: 3}


@dataclass(frozen=True, slots=True)
class RingLayout:
    """The kind of frames, their views and size [px]; writer and readers must agree on it."""

    kind: str
    views: tuple[str, ...]
    width: int
    height: int

    @property
    def bulk_shape(self) -> tuple[int, ...]:
        """Of one frame's array in the ring."""
        channels = _CHANNELS[self.kind]
        return (self.height, self.width) if channels == 1 else (self.height, self.width, channels)

    @property
    def ring_shape(self) -> RingShape:
        bulk_bytes = self.width * self.height * _CHANNELS[self.kind]
        return RingShape(_ENTRY.size, ENTRIES, bulk_bytes, IMAGES)

    @property
    def block_bytes(self) -> int:
        return len(self.views) * self.ring_shape.size

    def ring(self, block: mmap.mmap, view: str) -> SharedRing:
        shape = self.ring_shape
        return SharedRing(block, shape, self.views.index(view) * shape.size)


@dataclass(frozen=True, slots=True)
class RingEntry:
    """One frame that was put; `luma` is None if it was overwritten before it was read."""

    index: int
    t_ns: int
    capture_ns: int
    luma: Luma | None
    task: TaskRegion | None


class FrameReader:
    """Reads one view's ring from its beginning, or its newest frame."""

    def __init__(self, block: mmap.mmap, layout: RingLayout, view: str) -> None:
        self._ring = layout.ring(block, view)
        self._bulk_shape = layout.bulk_shape
        self._next = 0

    def written(self) -> int:
        """The number of frames put so far."""
        return self._ring.written()

    def await_more(self, written: int, timeout_ns: int) -> None:
        """Sleep while no more than `written` frames were put; it may return early, look again."""
        self._ring.await_more(written, timeout_ns)

    def newest_put_ns(self) -> int:
        """When the newest frame was put [ns]; 0 before the first."""
        newest = self._ring.newest()
        return 0 if newest is None else int(_ENTRY.unpack(newest[1])[1])

    def read(self, until: int) -> list[RingEntry]:
        """The frames not read yet as luma, up to the first `until` that were ever put."""
        oldest = self.written() - ENTRIES + 1  # the one before it may be overwritten right now
        self._next = max(self._next, oldest)
        entries = []
        for number in range(self._next, until):
            head, luma = self._ring.head(number), self._ring.bulk(number, self._luma)
            if head is None:  # overwritten while the ones before it were read
                continue
            index, t_ns, capture_ns, *region = _ENTRY.unpack(head)
            task = None if math.isnan(region[0]) else TaskRegion(*region)
            entries.append(RingEntry(index, t_ns, capture_ns, luma, task))
        self._next = max(self._next, until)
        return entries

    def newest_frame(self) -> tuple[int, Image] | None:
        """When the newest frame was captured [ns], and a copy of it.

        None before the first, or if it was overwritten meanwhile.
        """
        number = self._ring.written() - 1
        head = self._ring.head(number) if number >= 0 else None
        image = self._ring.bulk(number) if head is not None else None
        if head is None or image is None:
            return None
        capture_ns = int(_ENTRY.unpack(head)[2])
        return capture_ns, image.reshape(self._bulk_shape)

    def _luma(self, bulk: Bulk) -> Luma:
        image = bulk.reshape(self._bulk_shape)
        luma = image.copy() if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        return np.asarray(luma, np.uint8)


class FrameBlock:
    """The writer's memory for one kind of frames, all views; before `create` they are left out.

    `name` is what the readers' processes open it by, or `descriptor`, which they inherit, where the
    name is hidden already.
    """

    def __init__(self, layout: RingLayout) -> None:
        self.layout = layout
        self.name = f"{new_block_name()}-{layout.kind}"
        self.descriptor: int | None = None
        self._rings: dict[str, SharedRing] = {}
        self._stack = ExitStack()

    def create(self) -> None:
        """Make the memory, unless it is there; OSError if there is no room for it."""
        if self._rings:
            return
        with ExitStack() as stack:
            block = create_block(self.name, self.layout.block_bytes)
            stack.callback(self._let_go, block)
            stack.callback(self.hide)
            self.descriptor = open_descriptor(self.name)
            stack.callback(os.close, self.descriptor)
            self._rings = {view: self.layout.ring(block, view) for view in self.layout.views}
            self._stack = stack.pop_all()

    def put(
        self,
        view: str,
        index: int,
        t_ns: int,
        image: Image,
        capture_ns: int | None = None,
        task: TaskRegion | None = None,
    ) -> None:
        """Put a BGR image, shape (height, width, 3); ValueError for another size.

        Each view from one thread. `capture_ns`: None: `t_ns`.
        """
        ring, shape = self._rings.get(view), (self.layout.height, self.layout.width, 3)
        if ring is None:
            return
        if image.shape != shape:
            raise ValueError(f"expected a frame of shape {shape}, got {image.shape}")
        captured_ns = t_ns if capture_ns is None else capture_ns
        region = _NO_REGION if task is None else (task.x_px, task.y_px, task.radius_px)
        head = _ENTRY.pack(index, t_ns, captured_ns, *region)
        ring.put(head, partial(self._fill, image))
        ring.wake_readers()

    def hide(self) -> None:
        """Take the name away, once all readers have it open: nothing is left behind then."""
        remove_block(self.name)

    def close(self) -> None:
        """Give the memory back, when nothing is put any more; may be called twice."""
        self._stack.close()

    def _fill(self, image: Image, bulk: Bulk) -> None:
        frame = bulk.reshape(self.layout.bulk_shape)
        if frame.ndim == 2:
            cv2.cvtColor(image, cv2.COLOR_BGR2GRAY, dst=frame)
        else:
            np.copyto(frame, image)

    def _let_go(self, block: mmap.mmap) -> None:
        self._rings = {}
        self.descriptor = None
        block.close()
