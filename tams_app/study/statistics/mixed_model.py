"""A linear mixed-effects model with a random intercept per participant, by statsmodels (REML)."""

from __future__ import annotations

import math
import re
import warnings
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import statsmodels.formula.api as smf

_METHODS = ("bfgs", "lbfgs", "powell", "nm")  # any may fail where another finds the optimum
_SMALL = 1e-6  # of the residual's variance: none


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
    if np.ptp(values) < 1e-12:
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
