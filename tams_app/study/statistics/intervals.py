"""Means and shares with their 95 % intervals."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

CONFIDENCE = 0.95
RESAMPLES = 9_999
# with fewer, even differences of one sign are no evidence at 5 % (sign test: 2/2^5 = .0625), while
# a bootstrap of them would always exclude 0
FEWEST_TO_RESAMPLE = 6
_BOOTSTRAP_SEED = 0xB007


@dataclass(frozen=True, slots=True)
class Estimate:
    """A value with its interval over `n` units; both ends None where n is too small for one."""

    value: float
    low: float | None
    high: float | None
    n: int

    @property
    def excludes_zero(self) -> bool:
        """Whether the interval lies wholly on one side of 0."""
        return self.low is not None and self.high is not None and (self.low > 0 or self.high < 0)


def mean_interval(values: Sequence[float]) -> Estimate | None:
    """The mean with Student's t interval; None without values."""
    if not values:
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


def bootstrap_mean(values: Sequence[float], seed: int = _BOOTSTRAP_SEED) -> Estimate | None:
    """The mean with a bias-corrected accelerated bootstrap interval (Efron 1987), seeded.

    Below `FEWEST_TO_RESAMPLE` values there is no interval.
    """
    if not values:
        return None
    sample = np.asarray(values, dtype=np.float64)
    centre = float(np.mean(sample))
    if len(sample) < FEWEST_TO_RESAMPLE:
        return Estimate(centre, None, None, len(sample))
    if np.ptp(sample) < 1e-12:  # BCa has no acceleration where nothing varies
        return Estimate(centre, centre, centre, len(sample))
    found = stats.bootstrap(
        (sample,),
        np.mean,
        n_resamples=RESAMPLES,
        confidence_level=CONFIDENCE,
        method="BCa",
        random_state=np.random.default_rng(seed),
    ).confidence_interval
    return Estimate(centre, float(found.low), float(found.high), len(sample))


def means_by_unit(values: Mapping[str, Sequence[float]]) -> list[float]:
    """One mean per unit (a participant): what repeats within a unit is not independent."""
    return [float(np.mean(group)) for group in values.values() if len(group)]
