"""How far raters agree: Krippendorff's alpha and Kendall's W.

Sources: K. Krippendorff, "Computing Krippendorff's Alpha-Reliability" (2011), and his "Content
Analysis" (2004), page 241, for the two bounds; S. Siegel, "Nonparametric Statistics" (1956),
chapter 9, for W with its correction for ties.
"""

from __future__ import annotations

from enum import Enum

import numpy as np
from numpy.typing import NDArray
from scipy.stats import rankdata

Floats = NDArray[np.float64]

RELIABLE_ALPHA = 0.800  # from here on conclusions may be drawn
TENTATIVE_ALPHA = 0.667  # below it not even tentative ones


class Metric(Enum):
    """What the difference between two values means."""

    NOMINAL = "nominal"  # the same, or not
    ORDINAL = "ordinal"  # how many values lie between, as often as they were given
    INTERVAL = "interval"
    RATIO = "ratio"


def krippendorff_alpha(values: Floats, metric: Metric) -> float | None:
    """Alpha of `values`, shape (raters, units), NaN where a rater gave none.

    1 is perfect agreement, 0 what chance would do; None where it is not defined: no unit has two
    values, or all values are the same.
    """
    pairable = np.sum(np.isfinite(values), axis=0) >= 2
    values = values[:, pairable]
    levels = np.unique(values[np.isfinite(values)])
    if len(levels) < 2:
        return None
    coincidences = _coincidences(values, levels)
    totals = coincidences.sum(axis=0)
    differences = _differences(levels, totals, metric)
    observed = float(np.sum(coincidences * differences))
    expected = float(np.sum(np.outer(totals, totals) * differences)) / (totals.sum() - 1)
    return float(1 - observed / expected)


def _coincidences(values: Floats, levels: Floats) -> Floats:
    """How often two raters paired levels c and k in one unit; each unit weighs its values."""
    found = np.zeros((len(levels), len(levels)))
    for unit in values.T:
        given = unit[np.isfinite(unit)]
        counts = np.sum(given[:, np.newaxis] == levels, axis=0)
        found += (np.outer(counts, counts) - np.diag(counts)) / (len(given) - 1)
    return found


def _differences(levels: Floats, totals: Floats, metric: Metric) -> Floats:
    """The squared difference of each pair of levels."""
    first, second = levels[:, np.newaxis], levels[np.newaxis, :]
    if metric is Metric.NOMINAL:
        return np.asarray(first != second, dtype=np.float64)
    if metric is Metric.ORDINAL:
        # from the middle of one level's values to the middle of the other's
        middle = np.cumsum(totals) - totals / 2
        return np.asarray((middle[:, np.newaxis] - middle[np.newaxis, :]) ** 2)
    squared = (first - second) ** 2
    if metric is Metric.INTERVAL:
        return np.asarray(squared)
    total = (first + second) ** 2
    return np.asarray(np.divide(squared, total, out=np.zeros_like(squared), where=total > 0))


def kendall_w(values: Floats) -> float | None:
    """Kendall's coefficient of concordance of `values`, shape (raters, things), ties corrected.

    0 is no concordance, 1 the same order by all. Raters with a NaN are left out; None with fewer
    than two raters or two things, or if nobody distinguishes any.
    """
    complete = values[np.all(np.isfinite(values), axis=1)]
    raters, things = complete.shape
    if raters < 2 or things < 2:
        return None
    ranks = np.apply_along_axis(rankdata, 1, complete)
    sums = ranks.sum(axis=0)
    deviation = float(np.sum((sums - sums.mean()) ** 2))
    largest = (raters**2 * (things**3 - things) - raters * sum(map(_ties, ranks))) / 12
    return deviation / largest if largest > 0 else None


def _ties(ranks: Floats) -> int:
    """The sum of t³ − t over one rater's groups of t equal ranks."""
    _, sizes = np.unique(ranks, return_counts=True)
    return int(np.sum(sizes**3 - sizes))
