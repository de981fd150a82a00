"""What a session that works tells a face again and again: facts, frames, where the arm is."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from tams_app.config import CONFIG_DIRECTORY, load_config
from tams_app.faces.client import Face, FaceClient
from tams_app.faces.messages import Event, FaceFacts
from tams_app.records import Image
from tams_app.runtime.clock import MonotonicClock
from tams_app.station.mount_memory import MountMemory
from tams_app.units import NS_PER_MS
from tams_app.video.live.frame_ring import SHOWN, FrameBlock, RingLayout
from tests.faces.window.facts import OPENING
from tests.prediction.wrist import above, camera_of, lens_of, picture, placed

EVERY_S = 0.05
_LAYOUT = RingLayout(SHOWN, OPENING.views, OPENING.width, OPENING.height)


@contextmanager
def in_threads(*bodies: Callable[[threading.Event], None]) -> Iterator[None]:
    """Each in one of its own, for as long as the context lasts."""
    stop = threading.Event()
    threads = [threading.Thread(target=body, args=(stop,)) for body in bodies]
    for thread in threads:
        thread.start()
    try:
        yield
    finally:
        stop.set()
        for thread in threads:
            thread.join()


class FedFace:
    """A face's process, what is told to it again and again, and what it told."""

    def __init__(self, face: Face, arm: ArmElsewhere | None = None) -> None:
        """`arm`: whose frames it shows."""
        self.client = FaceClient(MonotonicClock(), face)
        self._block = FrameBlock(_LAYOUT) if arm is None else arm.block
        self._mount = None if arm is None else arm.mount
        self.events: list[Event] = []
        self._index = 0
        self._facts: FaceFacts | None = None
        self._lock = threading.Lock()

    @contextmanager
    def opened(self, folder: Path, **specification: Any) -> Iterator[None]:
        """With the default configuration, and this for its process."""
        self.client.launch(folder, **specification)
        config = load_config(CONFIG_DIRECTORY / "tams.yaml", {})
        self.client.open(config, self._block, blind=False, mount=self._mount)
        with in_threads(self._feed, self._listen):
            yield
        self.client.close()
        self._block.close()

    def put(self, frames: dict[str, Image]) -> int:
        """New frames of views, decoded now; when that is [ns]."""
        self._index, now_ns = self._index + 1, time.monotonic_ns()
        for view, image in frames.items():
            self._block.put(view, self._index, now_ns, image)
        return now_ns

    def hear(self, event: Event) -> None:
        self.events.append(event)

    def show(self, facts: FaceFacts) -> None:
        """These at once, and from now on, as by a session that works."""
        with self._lock:
            self._facts = facts
            self.client.show(facts)

    def pause(self) -> None:
        """Nothing, until others are shown."""
        with self._lock:
            self._facts = None

    def _listen(self, stop: threading.Event) -> None:
        for event in self.client.events(stop):
            self.hear(event)

    def _feed(self, stop: threading.Event) -> None:
        while not stop.wait(EVERY_S):
            with self._lock:
                if self._facts is not None:
                    self.client.show(self._facts)


LENS = lens_of(640, 480)
THERE, ELSEWHERE = above(0.0, 0.0, 0.2), above(0.02, 0.0, 0.2)  # little of the frame is outside
RECEIVED = picture(LENS, THERE)
_GREY = np.full((480, 640, 3), 90, np.uint8)
_LATE_NS = 120 * NS_PER_MS


class ArmElsewhere:
    """An arm that was at `THERE` and is believed to be at `now`, and frames of the first."""

    def __init__(self) -> None:
        self.mount = MountMemory({"eih": camera_of(640, 480)})
        self.block = FrameBlock(_LAYOUT)
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
        with in_threads(self.run):
            yield
        self.mount.close()
