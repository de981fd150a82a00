"""Capture threads' part: from a camera to its sender, remembering when each frame was taken."""

from __future__ import annotations

import threading
from collections import OrderedDict
from collections.abc import Callable

from hw.camera import Camera
from tams_app.records import Frame, ShownFrame

_REMEMBERED = 300  # ten seconds of frames
_WAIT_S = 0.2


class CaptureTimes:
    """When the last frames of one view were captured, by their index."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._times: OrderedDict[int, int] = OrderedDict()

    def add(self, index: int, capture_ns: int) -> None:
        with self._lock:
            self._times[index] = capture_ns
            if len(self._times) > _REMEMBERED:
                self._times.popitem(last=False)

    def of(self, index: int) -> int | None:
        """Capture time [ns] of frame `index`, None if it is not remembered."""
        with self._lock:
            return self._times.get(index)

    def age_ns(self, shown: ShownFrame | None, now_ns: int) -> int | None:
        """Age of the frame on screen; None where there is none, and if nobody knows."""
        capture_ns = None if shown is None else self.of(shown.index)
        return None if capture_ns is None else now_ns - capture_ns


class Capture:
    """Reads one camera and hands its frames on; the body of a Worker."""

    def __init__(
        self, camera: Camera, times: CaptureTimes, consumers: list[Callable[[Frame], None]]
    ) -> None:
        self._camera = camera
        self._times = times
        self._consumers = consumers

    def run(self, stop: threading.Event) -> None:
        while not stop.is_set():
            frame = self._camera.next_frame(_WAIT_S)
            if frame is None:
                continue  # a frozen camera shows as stale video
            self._times.add(frame.index, frame.capture_ns)
            for consume in self._consumers:
                consume(frame)
