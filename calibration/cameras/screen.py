"""The time pattern on a real screen."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from calibration.cameras.latency import ScreenTimes
from calibration.cameras.time_pattern import COUNTS, TimePattern
from tams_app import gst
from tams_app.errors import SetupError
from tams_app.runtime.clock import NS_PER_MS, NS_PER_S, Clock

_ELEMENTS = ("appsrc", "videoconvert", "ximagesink")
_STARTING_NS = 5 * NS_PER_S
_LOOK_NS = 20 * NS_PER_MS


def check_display() -> None:
    """SetupError if there is no screen to show the pattern on."""
    if not os.environ.get("DISPLAY"):
        raise SetupError("there is no display to show the pattern on; run it where a screen is")


@contextmanager
def shown_pattern(clock: Clock, rate_hz: int, module_px: int) -> Iterator[ScreenTimes]:
    """Count on the screen `rate_hz` times a second; SetupError if there is no display.

    The window's sink puts each image on at its own time of CLOCK_MONOTONIC, and leaves out what
    would be late, so the times follow from the start. What the display itself takes after that
    (compositor, half a refresh in the mean, the panel: some 10 to 50 ms) no program can see: it
    is part of what is measured.
    """
    check_display()
    gst.require_elements(_ELEMENTS)
    Gst = gst.load().Gst
    pattern = TimePattern(module_px)
    width, height = pattern.size
    pipeline = gst.parse_pipeline(
        "appsrc name=pattern format=time block=false max-buffers=3 "
        f'caps="video/x-raw,format=BGR,width={width},height={height},framerate={rate_hz}/1,'
        'pixel-aspect-ratio=1/1" ! videoconvert n-threads=1 ! ximagesink sync=true'
    )
    period_ns = NS_PER_S // rate_hz
    counting = _Counting(pattern, period_ns)
    pipeline.get_by_name("pattern").connect("need-data", counting.on_need)
    pipeline.use_clock(Gst.SystemClock.obtain())
    try:
        gst.set_playing(pipeline, "the window of the time pattern")
        deadline_ns = clock.now_ns() + _STARTING_NS
        while pipeline.get_state(0)[1] != Gst.State.PLAYING:
            reason = gst.poll_bus(pipeline)
            if reason or clock.now_ns() > deadline_ns:
                raise SetupError(f"the window of the time pattern did not open: {reason or 'late'}")
            clock.sleep_until_ns(clock.now_ns() + _LOOK_NS)
        yield ScreenTimes(
            pipeline.get_base_time(),
            period_ns,
            f"ximagesink at {rate_hz} images a second, each at its time of CLOCK_MONOTONIC; the "
            "display's own delay is not taken off",
        )
    finally:
        gst.shut_down(pipeline)


class _Counting:
    """Hands the next number to the window whenever it has room; in GStreamer's thread."""

    def __init__(self, pattern: TimePattern, period_ns: int) -> None:
        self._pattern, self._period_ns = pattern, period_ns
        self._count = 0

    def on_need(self, source: Any, _length: int) -> None:
        image = self._pattern.draw(self._count % COUNTS)
        at_ns = self._count * self._period_ns
        self._count += 1
        source.emit("push-buffer", gst.raw_buffer(image.tobytes(), at_ns, self._period_ns))
