"""Two groups compared: Welch's t-test and Cohen's d."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from tams_app.study.statistics.intervals import CONFIDENCE


@dataclass(frozen=True, slots=True)
class Welch:
    """First group minus second: difference with interval, t, degrees of freedom, p, Cohen's d.

    d: difference by the pooled standard deviation (Cohen 1988); None where nothing varies.
    """

    difference: float
    low: float
    high: float
    t: float
    df: float
    p: float
    d: float | None


def welch(first: Sequence[float], second: Sequence[float]) -> Welch | None:
    """Welch's unequal-variances t-test, two-sided; None below two values or without variance."""
    a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    if len(a) < 2 or len(b) < 2 or (np.ptp(a) < 1e-12 and np.ptp(b) < 1e-12):
        return None
    found = stats.ttest_ind(a, b, equal_var=False)
    interval = found.confidence_interval(CONFIDENCE)
    return Welch(
        float(np.mean(a) - np.mean(b)),
        float(interval.low),
        float(interval.high),
        float(found.statistic),
        float(found.df),
        float(found.pvalue),
        cohens_d(first, second),
    )


def cohens_d(first: Sequence[float], second: Sequence[float]) -> float | None:
    """(mean of the first − mean of the second) / pooled SD; None where it is not defined."""
    freedom = len(first) + len(second) - 2
    if len(first) < 2 or len(second) < 2:
        return None
    squares = sum(float(np.var(group, ddof=1)) * (len(group) - 1) for group in (first, second))
    pooled = math.sqrt(squares / freedom)
    return float(np.mean(first) - np.mean(second)) / pooled if pooled > 0 else None


def stars(p: float) -> str:
    """The usual marks: ns, *, ** and *** for p below .05, .01 and .001."""
    return "***" if p < 0.001 else "**" if p < 0.01 else "*" if p < 0.05 else "ns"
