"""How far the cameras' clocks and ways differ, from something that all of them saw."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from tams_app.records import Vector
from tams_app.runtime.clock import NS_PER_MS, NS_PER_S

FEWEST_EVENTS = 5
_LEAST_STEP_GREY = 8.0  # between light and dark
_SAME_EVENT_NS = 250 * NS_PER_MS


@dataclass(frozen=True, slots=True)
class Offset:
    """A camera's timestamps of an event minus the reference camera's; one standard error."""

    ms: float
    error_ms: float
    events: int


def switchings(brightness: Sequence[float], capture_ns: Sequence[int]) -> list[tuple[int, bool]]:
    """When the light was switched, and whether on, from mean grey levels of successive images.

    The middle of the interval in which the brightness crossed half way, moved by how far the
    image after it had come already: [ns]. Hysteresis of a quarter keeps flicker out.
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
    levels: Vector,
    capture_ns: Sequence[int],
    place: int,
    low: float,
    high: float,
) -> int:
    """Half way, on a straight line from the last image before the change to the first after."""
    middle = (low + high) / 2
    first = place - 1
    while first > 0 and abs(levels[first] - levels[first - 1]) > 0.1 * (high - low):
        first -= 1
    for before, after in pairwise(range(first, place + 1)):
        a, b = levels[before], levels[after]
        if (a - middle) * (b - middle) <= 0 and a != b:
            part = (middle - a) / (b - a)
            return capture_ns[before] + round(
                float(part) * (capture_ns[after] - capture_ns[before])
            )
    return capture_ns[place]


def offsets_from_switchings(
    switched: Mapping[str, Sequence[tuple[int, bool]]], reference: str
) -> dict[str, Offset]:
    """Each camera against `reference`, over the switchings that both saw; ValueError if too few."""
    return {
        camera: _offset(_paired(events, switched[reference]), camera)
        for camera, events in switched.items()
        if camera != reference
    }


def offsets_from_latencies(
    samples_ms: Mapping[str, Sequence[float]], reference: str, resolution_ms: float
) -> dict[str, Offset]:
    """Each camera's capture minus light, against the reference's: one screen seen by all.

    Cameras and screens may keep in step, so many readings are no better than one: each is
    uncertain by the screen's period, evenly.
    """
    found = {}
    base = np.asarray(samples_ms[reference], np.float64)
    for camera, samples in samples_ms.items():
        if camera == reference:
            continue
        mine = np.asarray(samples, np.float64)
        error = np.sqrt(2) * resolution_ms / np.sqrt(12)
        found[camera] = Offset(float(np.median(mine) - np.median(base)), float(error), len(mine))
    return found


def _paired(mine: Sequence[tuple[int, bool]], theirs: Sequence[tuple[int, bool]]) -> list[float]:
    """Differences [ms] of the switchings that belong together."""
    differences = []
    for at_ns, lit in mine:
        apart_ns = [at_ns - other_ns for other_ns, same in theirs if same == lit]
        nearest_ns = min(apart_ns, key=abs, default=_SAME_EVENT_NS)
        if abs(nearest_ns) < _SAME_EVENT_NS:
            differences.append(nearest_ns / NS_PER_MS)
    return differences


def _offset(differences_ms: list[float], camera: str) -> Offset:
    if len(differences_ms) < FEWEST_EVENTS:
        raise ValueError(
            f"{camera} and the reference saw {len(differences_ms)} switchings together; "
            f"{FEWEST_EVENTS} are needed"
        )
    sample = np.asarray(differences_ms)
    floor = (NS_PER_S / 30 / NS_PER_MS) / np.sqrt(12)  # a frame, evenly: what one event tells
    error = max(float(sample.std(ddof=1)), floor) / np.sqrt(len(sample))
    return Offset(float(np.mean(sample)), float(error), len(sample))
