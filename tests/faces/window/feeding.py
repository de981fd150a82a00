"""What a session that lives tells a face again and again: facts, frames, where the arm is."""

from __future__ import annotations

import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from tams_app.faces.client import FaceClient
from tams_app.faces.messages import Facts
from tams_app.runtime.clock import MonotonicClock
from tams_app.station.mount_memory import MountMemory
from tams_app.units import NS_PER_MS
from tams_app.video.live.frame_ring import SHOWN, FrameBlock, RingLayout
from tests.faces.window.facts import OPENING
from tests.prediction.wrist import above, camera_of, lens_of, picture, placed

EVERY_S = 0.05


class Feeding:
    """Tells a face the facts that were given last; before any, nothing."""

    def __init__(self, client: FaceClient) -> None:
        self._client = client
        self._facts: Facts | None = None
        self._lock = threading.Lock()
        self.stop = threading.Event()

    def show(self, facts: Facts) -> None:
        """These at once, and from now on."""
        with self._lock:
            self._facts = facts
            self._client.show(facts)

    def pause(self) -> None:
        """Nothing, until others are shown."""
        with self._lock:
            self._facts = None

    def run(self) -> None:
        while not self.stop.wait(EVERY_S):
            with self._lock:
                if self._facts is not None:
                    self._client.show(self._facts)


@contextmanager
def feeding(client: FaceClient) -> Iterator[Feeding]:
    """Feeds `client` for as long as the context lasts."""
    feeder = Feeding(client)
    thread = threading.Thread(target=feeder.run)
    thread.start()
    try:
        yield feeder
    finally:
        feeder.stop.set()
        thread.join()


LENS = lens_of(640, 480)
THERE, ELSEWHERE = above(0.0, 0.0, 0.2), above(0.02, 0.0, 0.2)  # little of the frame is outside
RECEIVED = picture(LENS, THERE)
_GREY = np.full((480, 640, 3), 90, np.uint8)
_LATE_NS = 120 * NS_PER_MS


class ArmElsewhere:
    """An arm that was at `THERE` and is believed to be at `now`, and frames of the first."""

    def __init__(self) -> None:
        self.mount = MountMemory({"eih": camera_of(640, 480)})
        self.block = FrameBlock(RingLayout(SHOWN, OPENING.views, 640, 480))
        self.now = THERE
        self.shows_frames = True

    def run(self, stop: threading.Event) -> None:
        """Frames and beliefs, as they come while a session runs."""
        clock, index = MonotonicClock(), 0
        while not stop.wait(0.01):
            now_ns, index = clock.now_ns(), index + 1
            self.mount.put(placed(now_ns, THERE, self.now, late_ns=20 * NS_PER_MS))
            for view in OPENING.views if self.shows_frames else ():
                frame = RECEIVED if view == "eih" else _GREY
                self.block.put(view, index, now_ns, frame, now_ns - _LATE_NS)

    @contextmanager
    def running(self) -> Iterator[None]:
        stop = threading.Event()
        thread = threading.Thread(target=self.run, args=(stop,))
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()
            self.mount.close()
