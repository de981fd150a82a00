"""Statistics of a study: pure functions over numbers; intervals are 95 %.

Differences are over pairs of trials, and between two groups as in the paper. Every comparison of a
report is decided by `paired_difference`, whichever side it favours. The linear mixed-effects model
has a random intercept per participant and is fitted by statsmodels (REML).
"""

from __future__ import annotations

import math
import re
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import statsmodels.formula.api as smf
from scipy import stats

from tams_app.report.pages import Estimate

CONFIDENCE = 0.95
# with fewer participants, differences of one sign are no evidence at 5 % (sign test: 2/2^5 = .0625)
FEWEST_TO_TEST = 6
ALPHA = 1 - CONFIDENCE
_NO_VARIATION = 1e-12
_METHODS = ("bfgs", "lbfgs", "powell", "nm")  # any may fail where another finds the optimum
_SMALL = 1e-6  # of the residual's variance: none


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


@dataclass(frozen=True, slots=True)
class PairedDifference:
    """First minus second: the mean over participants of each one's mean difference.

    Interval and `p` are those of the paired t test over participants, two-sided; below
    `FEWEST_TO_TEST` participants there is neither. `unpaired`: trials without their counterpart.
    """

    estimate: Estimate | None
    p: float | None
    pairs: int
    unpaired: int

    @property
    def is_shown(self) -> bool:
        """True if the test rejects "no difference" at 5 %."""
        return self.p is not None and self.p < ALPHA


def paired_difference(first: pd.Series, second: pd.Series) -> PairedDifference:
    """Values indexed by participant and what else a pair shares: (participant, repetition, …)."""
    first, second = first.dropna(), second.dropna()
    differences = (first - second).dropna()
    pairs, unpaired = len(differences), len(first) + len(second) - 2 * len(differences)
    by_participant = differences.groupby(level=0).mean().to_numpy(dtype=np.float64)
    estimate = mean_interval(by_participant.tolist())
    if estimate is None or estimate.n < FEWEST_TO_TEST:
        untested = estimate and Estimate(estimate.value, None, None, estimate.n)
        return PairedDifference(untested, None, pairs, unpaired)
    if np.ptp(by_participant) < _NO_VARIATION:  # t is not defined: all or nothing
        p = 1.0 if abs(estimate.value) < _NO_VARIATION else 0.0
    else:
        p = float(stats.ttest_1samp(by_participant, 0.0).pvalue)
    return PairedDifference(estimate, p, pairs, unpaired)


@dataclass(frozen=True, slots=True)
class Welch:
    """First group minus second: difference with interval, t, degrees of freedom, p, Cohen's d.

    d: difference by the pooled standard deviation (Cohen 1988); None where nothing varies.
    """

    difference: Estimate
    t: float
    df: float
    p: float
    d: float | None


def welch(first: Sequence[float], second: Sequence[float]) -> Welch | None:
    """Welch's unequal-variances t-test, two-sided; None below two values or without variance."""
    a, b = np.asarray(first, dtype=np.float64), np.asarray(second, dtype=np.float64)
    if len(a) < 2 or len(b) < 2 or max(np.ptp(a), np.ptp(b)) < _NO_VARIATION:
        return None
    found = stats.ttest_ind(a, b, equal_var=False)
    ends = found.confidence_interval(CONFIDENCE)
    difference = Estimate(
        float(np.mean(a) - np.mean(b)), float(ends.low), float(ends.high), len(a) + len(b)
    )
    return Welch(
        difference,
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


@dataclass(frozen=True, slots=True)
class Term:
    """One fixed effect with its standard error, Wald's z and p, and 95 % interval.

    `name`: `Intercept`, a level, or levels joined as in `tams × s3`.
    """

    name: str
    beta: float
    standard_error: float
    z: float
    p: float
    low: float
    high: float


@dataclass(frozen=True, slots=True)
class MixedModel:
    """A fitted model; `remarks` are sentences about what is doubtful in it."""

    terms: tuple[Term, ...]
    group_sd: float
    residual_sd: float
    n: int
    groups: int
    remarks: tuple[str, ...]


@dataclass(frozen=True, slots=True)
class NotFitted:
    """The reason why there is no model, in a sentence."""

    reason: str


def fit_mixed_model(rows: pd.DataFrame, formula: str) -> MixedModel | NotFitted:
    """`formula` over `rows`, with a random intercept for each value of its column `participant`.

    The first level of a categorical column is its reference. Rows with a missing value must be
    left out before. `NotFitted` says why where there is no model.
    """
    people = rows["participant"].nunique()
    if people < 2:
        return NotFitted("The model needs at least two participants.")
    model: Any = smf.mixedlm(formula, rows, groups=rows["participant"].astype(str))
    if problem := _problem(model):
        return NotFitted(problem)
    fitted, warned = _fit(model)
    if fitted is None:
        return NotFitted("The model did not converge: no estimate is given.")
    group_variance = max(0.0, float(np.asarray(fitted.cov_re)[0, 0]))
    return MixedModel(
        _terms(fitted),
        math.sqrt(group_variance),
        math.sqrt(float(fitted.scale)),
        len(rows),
        people,
        _remarks(group_variance, float(fitted.scale), warned),
    )


def _problem(model: Any) -> str | None:
    values, design = np.asarray(model.endog), np.asarray(model.exog)
    if len(values) <= design.shape[1] + 1:
        return f"The model needs more than {design.shape[1] + 1} trials; there are {len(values)}."
    if np.linalg.matrix_rank(design) < design.shape[1]:
        return "The model cannot be fitted: at least one condition has no trial."
    if np.ptp(values) < _NO_VARIATION:
        return "The model cannot be fitted: all values are the same."
    return None


def _fit(model: Any) -> tuple[Any, list[str]]:
    """The first method's fit that converges, and what statsmodels warned of; None if none does."""
    for method in _METHODS:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                fitted = model.fit(reml=True, method=method)
            except (np.linalg.LinAlgError, ValueError):
                continue  # the next method
        if fitted.converged and np.all(np.isfinite(fitted.bse_fe)):
            return fitted, [str(one.message) for one in caught]
    return None, []


def _terms(fitted: Any) -> tuple[Term, ...]:
    bounds = fitted.conf_int()
    return tuple(
        Term(
            " × ".join(re.findall(r"\[T\.([^\]]*)\]", name)) or name,
            float(beta),
            float(fitted.bse_fe[name]),
            float(fitted.tvalues[name]),
            float(fitted.pvalues[name]),
            float(bounds.loc[name, 0]),
            float(bounds.loc[name, 1]),
        )
        for name, beta in fitted.fe_params.items()
    )


def _remarks(group_variance: float, residual: float, warned: list[str]) -> tuple[str, ...]:
    if group_variance <= _SMALL * residual:
        return ("The participants' variance is estimated as zero.",)
    if any("boundary" in text or "singular" in text for text in warned):
        return ("The estimate lies near the boundary of what is possible.",)
    return ()
