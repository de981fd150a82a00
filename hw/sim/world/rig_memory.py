"""Memory that the simulated rig's processes share: the world's newest state, each view's frames.

The rig writes the world, which the renderer and the trial's rules read; the renderer writes frames,
which the cameras (`SimCamera`) read.
"""

from __future__ import annotations

import mmap
import struct
from dataclasses import dataclass
from functools import partial

import numpy as np

from hw.camera import Camera
from hw.sim.layout import HEIGHT_PX, VIEWS, WIDTH_PX
from tams_app.errors import DeviceError
from tams_app.records import Frame, Image, Pose, SceneTruth
from tams_app.rotation import Rotation
from tams_app.runtime.clock import Clock
from tams_app.runtime.shared_ring import (
    RingShape,
    SharedRing,
    create_block,
    open_block,
    remove_block,
)
from tams_app.units import NS_PER_S

SLOTS = 4  # frames per view: a reader has three periods to copy one before it is overwritten
QPOS_SIZE = 15  # joints 6, fingers 2, block 7

_STATE = struct.Struct(f"<q{QPOS_SIZE}d21d2d")
_WORLD_RING = RingShape(_STATE.size, heads=4)
_FRAME = struct.Struct("<3q")  # index, capture, when it was ready [ns]
_FRAME_RING = RingShape(_FRAME.size, SLOTS, WIDTH_PX * HEIGHT_PX * 3, SLOTS)
FRAMES_BYTES = len(VIEWS) * _FRAME_RING.size
_WORLD, _FRAMES = "world", "frames"


@dataclass(frozen=True, slots=True)
class WorldState:
    """Joint coordinates, `QPOS_SIZE` of them, and what follows from them in the base frame.

    `poses`: block, container and TCP, each x y z [m] and quaternion x y z w.
    """

    qpos: tuple[float, ...]
    poses: tuple[tuple[float, ...], ...]
    block_speed: float  # [m/s]
    fingers_opening: float  # [m]

    def truth(self, t_ns: int) -> SceneTruth:
        """The same as a record, stamped `t_ns`."""
        block, container, tcp = (
            Pose(np.array(pose[:3]), Rotation.from_quat(pose[3:])) for pose in self.poses
        )
        return SceneTruth(t_ns, block, container, tcp, self.block_speed, self.fingers_opening)


class WorldWriter:
    """Publishes the world's state under `memory_name`; one writer at a time."""

    def __init__(self, memory_name: str) -> None:
        self._block = create_block(f"{memory_name}-{_WORLD}", _WORLD_RING.size)
        self._ring = SharedRing(self._block, _WORLD_RING)

    def publish(self, t_ns: int, state: WorldState) -> None:
        """Publish `state` as that of the simulated instant `t_ns`."""
        block, container, tcp = state.poses
        record = _STATE.pack(
            t_ns, *state.qpos, *block, *container, *tcp,
            state.block_speed, state.fingers_opening,
        )  # fmt: skip
        self._ring.put(record)

    def close(self) -> None:
        self._block.close()


class WorldReader:
    """Reads the world's state under `memory_name`; DeviceError when the rig never started."""

    def __init__(self, memory_name: str) -> None:
        self._block = _attach(f"{memory_name}-{_WORLD}", _WORLD_RING.size)
        self._ring = SharedRing(self._block, _WORLD_RING)

    def read(self) -> tuple[int, WorldState] | None:
        """The newest simulated instant [ns] and the state then; None before the first."""
        newest = self._ring.newest()
        if newest is None:
            return None
        t_ns, *numbers, block_speed, opening = _STATE.unpack(newest[1])
        poses = tuple(tuple(numbers[at : at + 7]) for at in range(QPOS_SIZE, len(numbers), 7))
        return t_ns, WorldState(tuple(numbers[:QPOS_SIZE]), poses, block_speed, opening)

    def truth(self) -> SceneTruth | None:
        """Places of the things, for the trial's rules and the demo operator: not the application's.

        Stamped with the simulated instant; None before the first.
        """
        newest = self.read()
        return newest[1].truth(newest[0]) if newest is not None else None

    def close(self) -> None:
        self._block.close()


class FrameWriter:
    """Publishes frames under `memory_name`; one writer at a time."""

    def __init__(self, memory_name: str) -> None:
        self._block = create_block(f"{memory_name}-{_FRAMES}", FRAMES_BYTES)
        self._rings = {view: _frame_ring(self._block, view) for view in VIEWS}

    def publish(
        self, view: str, index: int, capture_ns: int, image: Image, ready_ns: int = 0
    ) -> None:
        """Put a BGR image, shape (480, 640, 3), in the ring of `view`.

        `ready_ns`: when it was rendered; 0: not known.
        """
        head = _FRAME.pack(index, capture_ns, ready_ns)
        ring = self._rings[view]
        ring.put(head, partial(np.copyto, src=image.ravel()))
        ring.wake_readers()

    def close(self) -> None:
        self._block.close()


def remove_memory(name: str) -> None:
    """Remove all memory of the rig `name`, also after its helpers were killed; may be repeated."""
    for part in (_WORLD, _FRAMES):
        remove_block(f"{name}-{part}")


def _frame_ring(block: mmap.mmap, view: str) -> SharedRing:
    return SharedRing(block, _FRAME_RING, VIEWS.index(view) * _FRAME_RING.size)


def _attach(name: str, size: int) -> mmap.mmap:
    try:
        block = open_block(name)
    except FileNotFoundError as error:
        raise DeviceError(
            "the simulated rig shares no memory; start its processes before this one"
        ) from error
    if len(block) != size:
        block.close()
        raise DeviceError("the simulated rig's memory has another layout; restart the session")
    return block


class SimCamera(Camera):
    """View `view` of the rig whose renderer publishes under `memory_name`, by the machine's clock.

    It sleeps until the renderer wakes it.
    """

    def __init__(self, view: str, memory_name: str, clock: Clock) -> None:
        self.view = view
        self._memory_name = memory_name
        self._clock = clock
        self._block: mmap.mmap | None = None
        self._looked_at = 0  # so many frames had been written at the last look
        self._last_index = -1

    def start(self) -> None:
        """Open the shared memory; DeviceError if there is no renderer or no such view."""
        if self.view not in VIEWS:
            raise DeviceError(
                f"the simulated rig has no camera {self.view!r}; use one of {', '.join(VIEWS)}"
            )
        self._block = _attach(f"{self._memory_name}-{_FRAMES}", FRAMES_BYTES)

    def next_frame(self, timeout_s: float) -> Frame | None:
        if self._block is None:
            raise DeviceError(f"camera {self.view} was not started")
        ring = _frame_ring(self._block, self.view)
        deadline_ns = self._clock.now_ns() + round(timeout_s * NS_PER_S)
        while True:
            written = ring.written()
            if written != self._looked_at:
                self._looked_at = written
                frame = self._newest(ring)
                if frame is not None and frame.index > self._last_index:
                    self._last_index = frame.index
                    return frame
            left_ns = deadline_ns - self._clock.now_ns()
            if left_ns <= 0:
                return None
            ring.await_more(written, left_ns)

    def _newest(self, ring: SharedRing) -> Frame | None:
        """A copy of the newest frame; None if it was overwritten meanwhile."""
        number = ring.written() - 1
        head = ring.head(number)
        pixels = ring.bulk(number) if head is not None else None
        if head is None or pixels is None:
            return None
        index, capture_ns, ready_ns = _FRAME.unpack(head)
        image = pixels.reshape(HEIGHT_PX, WIDTH_PX, 3)
        return Frame(self.view, index, capture_ns, image, ready_ns)

    def close(self) -> None:
        if self._block is not None:
            self._block.close()
            self._block = None
