"""The window that flashes, on a real screen."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from typing import Any

import numpy as np

from calibration.cameras.flashes import Flashes
from tams_app import gst
from tams_app.errors import SetupError
from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_MS, NS_PER_S

_ELEMENTS = ("appsrc", "videoconvert", "ximagesink")
_STARTING_NS = 5 * NS_PER_S
_POLL_NS = 20 * NS_PER_MS
WIDTH, HEIGHT = 960, 720


def check_display() -> None:
    """SetupError if there is no screen to flash."""
    if not os.environ.get("DISPLAY"):
        raise SetupError("there is no display to flash; run it where a screen is")


@contextmanager
def flashing_window(clock: Clock) -> Iterator[Flashes]:
    """Let a window flash; SetupError if there is no display.

    The window's sink shows each buffer at its own time of CLOCK_MONOTONIC, so the times follow
    from the start. What the display itself takes after that (compositor, half a refresh in the
    mean, the panel: some 10 to 50 ms) is not visible to a program: it is part of what is measured.
    """
    check_display()
    gst.require_elements(_ELEMENTS)
    Gst = gst.load().Gst
    pipeline = gst.parse_pipeline(
        "appsrc name=flashes format=time block=false max-buffers=3 "
        f'caps="video/x-raw,format=GRAY8,width={WIDTH},height={HEIGHT},framerate=0/1" '
        "! videoconvert n-threads=1 ! ximagesink sync=true"
    )
    schedule = Flashes.beginning(0)
    feeder = _Feeder(schedule)
    pipeline.get_by_name("flashes").connect("need-data", feeder.on_need)
    pipeline.use_clock(Gst.SystemClock.obtain())
    try:
        gst.set_playing(pipeline, "the window that flashes")
        deadline_ns = clock.now_ns() + _STARTING_NS
        while pipeline.get_state(0)[1] != Gst.State.PLAYING:
            reason = gst.poll_bus(pipeline)
            if reason or clock.now_ns() > deadline_ns:
                raise SetupError(f"the window that flashes did not open: {reason or 'late'}")
            clock.sleep_until_ns(clock.now_ns() + _POLL_NS)
        yield Flashes(pipeline.get_base_time(), schedule.after_ns)
    finally:
        gst.shut_down(pipeline)


class _Feeder:
    """Hands the next change to the window whenever it has room; in GStreamer's thread."""

    def __init__(self, schedule: Flashes) -> None:
        self._stretches = enumerate(pairwise((0, *schedule.after_ns)))

    def on_need(self, source: Any, _length: int) -> None:
        stretch = next(self._stretches, None)
        if stretch is None:
            source.emit("end-of-stream")
            return
        number, (from_ns, to_ns) = stretch
        image = np.full((HEIGHT, WIDTH), 255 * (number % 2), np.uint8)
        source.emit("push-buffer", gst.raw_buffer(image.tobytes(), from_ns, to_ns - from_ns))
