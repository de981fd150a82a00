"""A camera of the simulated rig: takes the renderer's frames out of shared memory."""

from __future__ import annotations

from hw.camera import Camera
from hw.sim.viewpoints import VIEWS
from hw.sim.world.rig_memory import RigFrameReader
from tams_app.errors import DeviceError
from tams_app.records import Frame
from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_S


class SimCamera(Camera):
    """View `view` of the rig whose renderer publishes under `memory_name`, by the machine's clock.

    It sleeps until the renderer, or the one that has taken its place, wakes it.
    """

    def __init__(self, view: str, memory_name: str, clock: Clock) -> None:
        self.view = view
        self._memory_name = memory_name
        self._clock = clock
        self._reader: RigFrameReader | None = None
        self._looked_at = 0  # so many frames had been written at the last look
        self._last_index = -1

    def start(self) -> None:
        """Open the shared memory; DeviceError if there is no renderer or no such view."""
        if self.view not in VIEWS:
            raise DeviceError(
                f"the simulated rig has no camera {self.view!r}; use one of {', '.join(VIEWS)}"
            )
        self._reader = RigFrameReader(self._memory_name, self.view)

    def next_frame(self, timeout_s: float) -> Frame | None:
        reader = self._reader
        if reader is None:
            raise DeviceError(f"camera {self.view} was not started")
        deadline_ns = self._clock.now_ns() + round(timeout_s * NS_PER_S)
        while True:
            written = reader.written()
            if written != self._looked_at:
                self._looked_at = written
                frame = reader.newest()
                if frame is not None and frame.index > self._last_index:
                    self._last_index = frame.index
                    return frame
            left_ns = deadline_ns - self._clock.now_ns()
            if left_ns <= 0:
                return None
            reader.await_more(written, left_ns)

    def close(self) -> None:
        if self._reader is not None:
            self._reader.close()
            self._reader = None
