"""Percentiles and means that are null when nothing was measured."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

Floats: TypeAlias = NDArray[np.float64]
Integers: TypeAlias = NDArray[np.int64]
Flags: TypeAlias = NDArray[np.bool_]
Number: TypeAlias = float | None


def percentiles(values: Floats, names: Sequence[str]) -> dict[str, Number]:
    """For names such as p50, p99_9 and max: that percentile, null without values."""
    if not len(values):
        return dict.fromkeys(names)
    ranks = [100.0 if name == "max" else float(name[1:].replace("_", ".")) for name in names]
    found = np.percentile(values, ranks)
    return {name: round(float(value), 4) for name, value in zip(names, found, strict=True)}


def mean(values: Floats) -> Number:
    return round(float(np.mean(values)), 4) if len(values) else None


def ratio(part: float, whole: float) -> Number:
    """`part`/`whole`, null when there is no whole."""
    return round(float(part / whole), 6) if whole > 0 else None


def step_mean(times_ns: Integers, values: Floats, start_ns: int, end_ns: int) -> Number:
    """Mean over [start, end) of a quantity that keeps each value until the next time.

    Before the first time it has the first value; null without values or time.
    """
    if not len(values) or end_ns <= start_ns:
        return None
    order = np.argsort(times_ns, kind="stable")
    edges = np.clip(np.append(times_ns[order], end_ns), start_ns, end_ns)
    edges[0] = start_ns
    durations = np.diff(edges)
    return round(float(np.sum(durations * values[order]) / (end_ns - start_ns)), 4)


def last_before(times_ns: Integers, values: Floats, at_ns: Integers) -> Floats:
    """The value in force at each of `at_ns`; NaN before the first. `times_ns` ascending."""
    position = np.searchsorted(times_ns, at_ns, side="right") - 1
    return np.where(position >= 0, values[np.maximum(position, 0)], np.nan)
