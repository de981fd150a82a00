"""Frame rate, jitter and drops of a camera, and whether its timestamps are the process's clock."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from tams_app.records import Vector
from tams_app.units import NS_PER_MS, NS_PER_S

FEWEST_FRAMES = 30
_RATE_TOLERANCE = 0.01
_MOST_MISSED = 0.01
_JITTER_MS = 8.0  # a quarter of a frame
_OLDEST_MS = 1000.0
_LARGEST_DRIFT_PPM = 200.0  # crystals differ by 100 at most; beyond it is another kind of clock
_SIGMAS = 4.0
_FOLLOWING = 0.1  # how much of a frame's deviation the grid takes over


@dataclass(frozen=True, slots=True)
class Rate:
    """How regularly a camera's frames were taken."""

    frames: int
    rate_hz: float
    jitter_ms: float  # standard deviation from an even grid
    worst_ms: float  # largest deviation from it
    missed: int  # places of the grid that stayed empty
    seconds: float


def measure_rate(capture_ns: Sequence[int]) -> Rate:
    """From capture times in order; ValueError below `FEWEST_FRAMES`.

    The grid is the camera's own: its period is the median interval, and a straight line through
    the frames' places on it is what jitter is off.
    """
    times = np.asarray(capture_ns, np.float64) - capture_ns[0]
    if len(times) < FEWEST_FRAMES:
        raise ValueError(f"needs {FEWEST_FRAMES} frames, got {len(times)}")
    places = _places(times)
    slope, start = np.polyfit(places, times, 1)
    residual_ms = (times - (slope * places + start)) / NS_PER_MS
    return Rate(
        frames=len(times),
        rate_hz=NS_PER_S / float(slope),
        jitter_ms=float(residual_ms.std()),
        worst_ms=float(np.abs(residual_ms).max()),
        missed=int(places[-1]) + 1 - len(times),
        seconds=float(times[-1]) / NS_PER_S,
    )


def _places(times_ns: Vector) -> Vector:
    """Each frame's place on a grid that follows the frames slowly: jitter makes no drops."""
    period_ns = float(np.median(np.diff(times_ns)))
    places, expected_ns = np.zeros(len(times_ns)), 0.0
    for number in range(1, len(times_ns)):
        steps = round((times_ns[number] - expected_ns) / period_ns)
        if steps < 1 and number > 1 and places[number - 1] - places[number - 2] > 1:
            places[number - 1] -= 1  # it was late itself: this one's place shows it
        else:
            steps = max(1, steps)
        places[number] = places[number - 1] + max(1, steps)
        expected_ns += steps * period_ns
        expected_ns += _FOLLOWING * (times_ns[number] - expected_ns)
    return places


def rate_advice(rate: Rate, fps: int) -> list[str]:
    """What is wrong with it, one sentence each."""
    advice = []
    if abs(rate.rate_hz - fps) > _RATE_TOLERANCE * fps:
        cause = "the exposure may be too long" if rate.rate_hz < fps else "choose another mode"
        advice.append(f"{rate.rate_hz:.2f} frames a second instead of {fps}: {cause}")
    if rate.missed > _MOST_MISSED * (rate.frames + rate.missed):
        advice.append(
            f"{rate.missed} of {rate.frames + rate.missed} frames are missing: give the camera a "
            "USB bus of its own, or use mjpeg"
        )
    if rate.jitter_ms > _JITTER_MS:
        advice.append(f"frames come {rate.jitter_ms:.0f} ms off their time: look at the USB hub")
    return advice


def clock_problem(capture_ns: Sequence[int], delivered_ns: Sequence[int]) -> str:
    """What is wrong with the timestamps as the process's clock, "" if nothing is.

    `delivered_ns`: when each image was in hand. That takes at least some constant time, so the
    lower edge of the ages must stay level: its slope is the drift (the youngest of each tenth of
    the time, a line through them). ValueError below `FEWEST_FRAMES`.
    """
    if len(capture_ns) < FEWEST_FRAMES:
        raise ValueError(f"needs {FEWEST_FRAMES} frames, got {len(capture_ns)}")
    start_ns = delivered_ns[0]
    at_s = np.array([(t - start_ns) / NS_PER_S for t in delivered_ns])
    ages_ms = np.array([(d - c) / NS_PER_MS for c, d in zip(capture_ns, delivered_ns, strict=True)])
    drift_ppm, error_ppm = _slope_of_lower_edge(at_s, ages_ms)
    age_ms = float(np.median(ages_ms))
    if ages_ms.min() < 0:
        return "images carry times that lie ahead: not the host's monotonic clock"
    if age_ms > _OLDEST_MS:
        return f"images are {age_ms / 1000:.1f} s old: not the host's monotonic clock"
    if abs(drift_ppm) > max(_LARGEST_DRIFT_PPM, _SIGMAS * error_ppm):
        return f"timestamps drift by {drift_ppm:.0f} ppm: the camera keeps a clock of its own"
    return ""


def _slope_of_lower_edge(at_s: Vector, ages_ms: Vector) -> tuple[float, float]:
    """[ppm] with its standard error, from the minima of ten stretches of the time."""
    parts = np.array_split(np.arange(len(at_s)), 10)
    lowest = [part[int(np.argmin(ages_ms[part]))] for part in parts]
    x, y = at_s[lowest] - at_s[lowest].mean(), ages_ms[lowest]
    spread = float(np.sum(x**2))
    slope = float(np.sum(x * (y - y.mean()))) / spread
    residual = y - y.mean() - slope * x
    error = float(np.sqrt(np.sum(residual**2) / (len(x) - 2) / spread))
    return slope * 1000.0, error * 1000.0  # ms/s -> ppm
