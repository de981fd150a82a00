"""Wakes the window as soon as the large picture's view has a new frame."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping

from tams_app.units import NS_PER_MS
from tams_app.video.live.frame_ring import FrameReader

_LOOK_NS = 100 * NS_PER_MS  # whether it is to end, or another view is the large one


class Arrivals:
    """Waits for frames of `view`, which may be set to another at any time; the body of a Worker."""

    def __init__(self, frames: Mapping[str, FrameReader], view: str, wake: Callable[[], None]):
        """`wake` is called in the worker's thread: it must only hand over."""
        self.view = view
        self._frames = frames
        self._wake = wake

    def run(self, stop: threading.Event) -> None:
        seen: dict[str, int] = {}
        while not stop.is_set():
            view = self.view
            reader = self._frames[view]
            written = reader.written()
            if written == seen.get(view, 0):
                reader.await_more(written, _LOOK_NS)
                continue
            seen[view] = written
            self._wake()
