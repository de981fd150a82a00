"""Means and shares with their 95 % intervals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

CONFIDENCE = 0.95


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value with its interval over `n` units; both ends None where n is too small for one."""

    value: float
    low: float | None
    high: float | None
    n: int


def mean_interval(values: Sequence[float]) -> Estimate | None:
    """The mean with Student's t interval; None without values."""
    if not len(values):
        return None
    sample = np.asarray(values, dtype=np.float64)
    centre = float(np.mean(sample))
    if len(sample) < 2:
        return Estimate(centre, None, None, len(sample))
    half = float(stats.sem(sample) * stats.t.ppf((1 + CONFIDENCE) / 2, len(sample) - 1))
    return Estimate(centre, centre - half, centre + half, len(sample))


def wilson_interval(successes: int, n: int) -> Estimate | None:
    """A share with Wilson's score interval (Wilson 1927; Newcombe 1998, method 3)."""
    if n == 0:
        return None
    found = stats.binomtest(successes, n).proportion_ci(CONFIDENCE, method="wilson")
    return Estimate(successes / n, float(found.low), float(found.high), n)
