"""A camera's latency from a screen that flashes: light to time stamp.

The screen turns white and black at known times, in random intervals so that neither keeps in step
with the camera. The mean brightness of each frame gives, by interpolation, when the camera's time
stamps say that it happened. One flash gives the delay to a frame interval; their mean is better by
the square root of their number. Turning white and turning black are averaged apart: whatever a
camera's gamma does to a half-exposed frame does the opposite in both, and cancels.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from tams_app import gst
from tams_app.errors import SetupError
from tams_app.records import Vector
from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_MS, NS_PER_S

FEWEST_FLASHES = 12
_INTERVAL_S = (0.5, 0.9)  # between two of them: those to white are at least 1 s apart
_SEED = 0xF1A5
_SOONEST_MS, _LATEST_MS = -50.0, 450.0  # of a camera
_OUTLIER_MS = 50.0  # from the median: something else changed the light
_LEAST_STEP_GREY = 8.0  # between dark and light
_FRAME_MS = 1000 / 30


@dataclass(frozen=True, slots=True)
class Flashes:
    """When a screen changes: at `start_ns` + `after_ns[i]`; black before, even ones to white."""

    start_ns: int
    after_ns: tuple[int, ...]

    @staticmethod
    def beginning(start_ns: int, count: int = 800) -> Flashes:
        """Random intervals, the same each time; 800 of them last ten minutes."""
        intervals_s = np.random.default_rng(_SEED).uniform(*_INTERVAL_S, count)
        after_ns = np.cumsum(intervals_s * NS_PER_S)
        return Flashes(start_ns, tuple(int(after) for after in after_ns))

    def lit_share(self, from_ns: int, to_ns: int) -> float:
        """Of a stretch of time, how much of it the screen is white [0..1]."""
        moments = np.linspace(from_ns, to_ns, 20) - self.start_ns
        return float((np.searchsorted(self.after_ns, moments, side="right") % 2).mean())


@dataclass(frozen=True, slots=True)
class Latency:
    """From the light to a camera's time stamp; `error_ms`: one standard error."""

    ms: float
    error_ms: float
    flashes: int


def camera_latency(
    brightness: Sequence[float], capture_ns: Sequence[int], flashes: Flashes
) -> Latency:
    """The latency from mean grey levels of successive frames; ValueError if too few flashes show.

    Args:
        brightness: Mean grey level of each frame, 0 to 255.
        capture_ns: The time stamp of each frame.
        flashes: What the screen did.
    """
    delays: dict[bool, list[float]] = {True: [], False: []}
    for at_ns, lit in switchings(brightness, capture_ns):
        same = [flashes.start_ns + after for after in flashes.after_ns[not lit :: 2]]
        nearest = [delay for t_ns in same if (delay := (at_ns - t_ns) / NS_PER_MS) > _SOONEST_MS]
        if nearest and min(nearest) < _LATEST_MS:
            delays[lit].append(min(nearest))
    everything = np.array([*delays[True], *delays[False]])
    middle = float(np.median(everything)) if len(everything) else 0.0
    kept = [
        [delay for delay in part if abs(delay - middle) <= _OUTLIER_MS] for part in delays.values()
    ]
    count = sum(map(len, kept))
    if count < FEWEST_FLASHES or not all(kept):
        raise ValueError(f"{count} flashes were seen, {FEWEST_FLASHES} are needed")
    spread = max(float(np.std([*kept[0], *kept[1]], ddof=1)), _FRAME_MS / np.sqrt(12.0))
    return Latency(float(np.mean([np.mean(part) for part in kept])), spread / np.sqrt(count), count)


def switchings(brightness: Sequence[float], capture_ns: Sequence[int]) -> list[tuple[int, bool]]:
    """When the light was switched [ns], and whether on, from grey levels of successive frames.

    Hysteresis of a quarter keeps flicker out.
    """
    levels = np.asarray(brightness, np.float64)
    if len(levels) < 3:
        return []
    low, high = (float(part) for part in np.percentile(levels, (5, 95)))
    if high - low < _LEAST_STEP_GREY:
        return []
    upper, lower = low + 0.75 * (high - low), low + 0.25 * (high - low)
    found: list[tuple[int, bool]] = []
    lit = bool(levels[0] > (low + high) / 2)
    for place in range(1, len(levels)):
        now = levels[place] > lower if lit else levels[place] >= upper
        if now != lit:
            found.append((_crossing_ns(levels, capture_ns, place, low, high), not lit))
            lit = not lit
    return found


def _crossing_ns(
    levels: Vector, capture_ns: Sequence[int], place: int, low: float, high: float
) -> int:
    """Half way, on a straight line from the last frame before the change to the first after."""
    middle = (low + high) / 2
    first = place - 1
    while first > 0 and abs(levels[first] - levels[first - 1]) > 0.1 * (high - low):
        first -= 1
    for before, after in pairwise(range(first, place + 1)):
        a, b = levels[before], levels[after]
        if (a - middle) * (b - middle) <= 0 and a != b:
            part = float((middle - a) / (b - a))
            return capture_ns[before] + round(part * (capture_ns[after] - capture_ns[before]))
    return capture_ns[place]


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
    stretches = enumerate(pairwise((0, *schedule.after_ns)))

    def feed(source: Any, _length: int) -> None:
        """Hand the next change to the window whenever it has room; in GStreamer's thread."""
        stretch = next(stretches, None)
        if stretch is None:
            source.emit("end-of-stream")
            return
        number, (from_ns, to_ns) = stretch
        image = np.full((HEIGHT, WIDTH), 255 * (number % 2), np.uint8)
        source.emit("push-buffer", gst.raw_buffer(image, from_ns, to_ns - from_ns))

    pipeline.get_by_name("flashes").connect("need-data", feed)
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
