"""A camera of the simulated rig: takes the renderer's frames out of shared memory."""

from __future__ import annotations

from hw.camera import Camera
from hw.sim.world.rig_memory import FrameReader, FrameShape
from tams_app.errors import DeviceError
from tams_app.records import Frame
from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_MS, NS_PER_S

_POLL_NS = NS_PER_MS
_IDLE_POLL_NS = 10 * NS_PER_MS
_LEARNING = 0.2  # how fast the estimate of the delivery delay follows


class SimCamera(Camera):
    """View `view` of the rig whose renderer publishes under `memory_name`.

    Waiting costs little: it sleeps to just before the next frame is to be expected, from the
    camera's time grid and how long delivery took of late, and only then looks every millisecond.
    """

    def __init__(
        self, view: str, memory_name: str, clock: Clock, shape: FrameShape | None = None
    ) -> None:
        self.view = view
        self._memory_name = memory_name
        self._clock = clock
        self._shape = shape or FrameShape()
        self._reader: FrameReader | None = None
        self._last_index = -1
        self._delay_ns = 0.0  # from a frame's instant on the grid to its delivery

    def start(self) -> None:
        """Open the shared memory; DeviceError if there is no renderer or no such view."""
        if self.view not in self._shape.views:
            raise DeviceError(
                f"the simulated rig has no camera {self.view!r}; use one of "
                f"{', '.join(self._shape.views)}"
            )
        self._reader = FrameReader(self._memory_name, self.view, self._shape)

    def next_frame(self, timeout_s: float) -> Frame | None:
        reader = self._reader
        if reader is None:
            raise DeviceError(f"camera {self.view} was not started")
        deadline_ns = self._clock.now_ns() + round(timeout_s * NS_PER_S)
        seen = -1
        while True:
            now_ns = self._clock.now_ns()
            written = reader.written()
            if written != seen:
                seen = written
                frame = reader.newest()
                if frame is not None and frame.index > self._last_index:
                    self._learn(reader, frame, now_ns)
                    return frame
            if now_ns >= deadline_ns:
                return None
            self._clock.sleep_until_ns(min(self._wake_ns(reader, now_ns), deadline_ns))

    def close(self) -> None:
        if self._reader is not None:
            self._reader.close()
            self._reader = None

    def _learn(self, reader: FrameReader, frame: Frame, now_ns: int) -> None:
        self._last_index = frame.index
        grid = reader.grid()
        delay_ns = now_ns - (grid.start_ns + frame.index * grid.period_ns)
        if delay_ns < grid.period_ns:
            self._delay_ns += _LEARNING * (delay_ns - self._delay_ns)

    def _wake_ns(self, reader: FrameReader, now_ns: int) -> int:
        """When to look again."""
        grid = reader.grid()
        if grid.start_ns == 0:
            return now_ns + _IDLE_POLL_NS
        due_ns = grid.start_ns + (self._last_index + 1) * grid.period_ns
        expected_ns = due_ns + round(self._delay_ns) - 2 * _POLL_NS
        return max(now_ns + _POLL_NS, expected_ns)
