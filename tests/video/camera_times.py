"""When a camera takes its frames: at rates that change, with jitter, with frames missed."""

from __future__ import annotations

import random

from tams_app.units import NS_PER_S


def camera_times_ns(
    *segments: tuple[float, float],
    start_ns: int = NS_PER_S,
    jitter: float = 0.0,
    missed: float = 0.0,
    seed: int = 1,
) -> list[int]:
    """Capture times [ns].

    Args:
        segments: frames per second, and for how many seconds, one after the other.
        start_ns: time of the first place on the grid.
        jitter: the most by which a frame is off its place, in intervals.
        missed: the share of frames that are not taken.
        seed: of jitter and missed frames.
    """
    draw = random.Random(seed)
    times_ns, at_ns = [], float(start_ns)
    for rate_hz, seconds in segments:
        interval_ns = NS_PER_S / rate_hz
        for _ in range(round(rate_hz * seconds)):
            if draw.random() >= missed:
                times_ns.append(round(at_ns + draw.uniform(0, jitter) * interval_ns))
            at_ns += interval_ns
    return times_ns
