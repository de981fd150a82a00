"""From readings of a time pattern to latencies: from light to capture, and on to the eye."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tams_app.runtime.clock import NS_PER_MS

FEWEST_READINGS = 20
_OUTLIER_MS = 50.0  # from the median: a damaged reading, not a late image


@dataclass(frozen=True, slots=True)
class ScreenTimes:
    """When the screen was to show which number: `count` from `start_ns` + count·`period_ns` on."""

    start_ns: int
    period_ns: int
    method: str  # how it was put on the screen

    def lit_ns(self, count: int) -> int:
        """The middle of the time at which `count` was on the screen."""
        return self.start_ns + count * self.period_ns + self.period_ns // 2


@dataclass(frozen=True, slots=True)
class Latency:
    """Of one stretch of the way; `error_ms`: what the method cannot tell, one standard deviation.

    `samples_ms` are the single values, shape (n,).
    """

    median_ms: float
    p5_ms: float
    p95_ms: float
    error_ms: float
    rejected: int
    samples_ms: NDArray[np.float64]


def latency(
    samples_ms: Sequence[float], resolution_ms: float, outlier_ms: float | None = _OUTLIER_MS
) -> Latency:
    """Statistics without outliers (None: nothing is one); ValueError if too few remain.

    One reading is uncertain by the screen's period, evenly: `resolution_ms`/√12. The mean of many
    that the screen and the camera do not keep in step is better by √n; where both keep in step
    (60 and 30 Hz) it is not, so that figure is not used.
    """
    values = np.asarray(samples_ms, np.float64)
    middle = float(np.median(values)) if len(values) else 0.0
    far_ms = np.inf if outlier_ms is None else outlier_ms
    kept = values[np.abs(values - middle) <= far_ms]
    if len(kept) < FEWEST_READINGS:
        raise ValueError(f"needs {FEWEST_READINGS} readings that agree, got {len(kept)}")
    low, median, high = (float(part) for part in np.percentile(kept, (5, 50, 95)))
    return Latency(median, low, high, resolution_ms / np.sqrt(12.0), len(values) - len(kept), kept)


def camera_latency(
    capture_ns: Sequence[int], counts: Sequence[int], screen: ScreenTimes
) -> Latency:
    """From the light of the screen to each image's capture time."""
    samples = [
        (captured - screen.lit_ns(count)) / NS_PER_MS
        for captured, count in zip(capture_ns, counts, strict=True)
    ]
    return latency(samples, screen.period_ns / NS_PER_MS)


def chained(first: Latency, second: Latency) -> Latency:
    """The whole of two stretches measured on different images: each value with each other."""
    sums = (first.samples_ms[:, None] + second.samples_ms[None, :]).ravel()
    low, median, high = (float(part) for part in np.percentile(sums, (5, 50, 95)))
    return Latency(median, low, high, float(np.hypot(first.error_ms, second.error_ms)), 0, sums)
