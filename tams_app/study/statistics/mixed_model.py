"""A linear mixed-effects model with a random intercept per participant, by statsmodels (REML)."""

from __future__ import annotations

import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import import_module
from typing import Any

import numpy as np
from numpy.typing import NDArray

INTERCEPT = "intercept"
_METHODS = ("bfgs", "lbfgs", "powell", "nm")  # any may fail where another finds the optimum
_SMALL = 1e-6  # of the residual's variance: none


@dataclass(frozen=True, slots=True)
class Term:
    """One fixed effect with its standard error, Wald's z and p, and 95 % interval."""

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

    def term(self, name: str) -> Term:
        """The fixed effect of that name."""
        return next(term for term in self.terms if term.name == name)


@dataclass(frozen=True, slots=True)
class NotFitted:
    """Why there is no model, in a sentence."""

    reason: str


def interaction_columns(
    first: Sequence[str], second: Sequence[str], first_levels: Sequence[str], levels: Sequence[str]
) -> dict[str, list[float]]:
    """Treatment-coded columns of first × second; the first level of each is the reference."""
    columns = {a: [float(one == a) for one in first] for a in first_levels[1:]}
    columns |= {b: [float(one == b) for one in second] for b in levels[1:]}
    for a in first_levels[1:]:
        for b in levels[1:]:
            both = zip(first, second, strict=True)
            columns[f"{a} × {b}"] = [float((one, two) == (a, b)) for one, two in both]
    return columns


def fit_mixed_model(
    values: Sequence[float], columns: Mapping[str, Sequence[float]], groups: Sequence[str]
) -> MixedModel | NotFitted:
    """values ~ intercept + columns + (1 | groups); `NotFitted` says why where there is no model."""

    names = [INTERCEPT, *columns]
    design = np.column_stack([np.ones(len(values)), *columns.values()])
    if problem := _problem(values, design, groups):
        return NotFitted(problem)
    fitted, warned = _fit(np.asarray(values, dtype=np.float64), design, np.asarray(groups))
    if fitted is None:
        return NotFitted("The model did not converge: no estimate is given.")
    group_variance = max(0.0, float(np.asarray(fitted.cov_re)[0, 0]))
    return MixedModel(
        _terms(names, fitted),
        math.sqrt(group_variance),
        math.sqrt(float(fitted.scale)),
        len(values),
        len(set(groups)),
        _remarks(group_variance, float(fitted.scale), warned),
    )


def _fit(
    values: NDArray[np.float64], design: NDArray[np.float64], groups: NDArray[np.str_]
) -> tuple[Any, list[str]]:
    """The first method's fit that converges, and what statsmodels warned of; None if none does."""
    mixed_lm: Any = import_module("statsmodels.regression.mixed_linear_model").MixedLM
    for method in _METHODS:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            try:
                fitted = mixed_lm(values, design, groups).fit(reml=True, method=method)
            except (np.linalg.LinAlgError, ValueError):
                continue  # the next method
        if fitted.converged and np.all(np.isfinite(fitted.bse_fe)):
            return fitted, [str(one.message) for one in caught]
    return None, []


def _problem(
    values: Sequence[float], design: NDArray[np.float64], groups: Sequence[str]
) -> str | None:
    if len(set(groups)) < 2:
        return "The model needs at least two participants."
    if len(values) <= design.shape[1] + 1:
        return f"The model needs more than {design.shape[1] + 1} trials; there are {len(values)}."
    if np.linalg.matrix_rank(design) < design.shape[1]:
        return "The model cannot be fitted: at least one condition has no trial."
    if np.ptp(np.asarray(values)) < 1e-12:
        return "The model cannot be fitted: all values are the same."
    return None


def _terms(names: Sequence[str], fitted: Any) -> tuple[Term, ...]:
    bounds = np.asarray(fitted.conf_int())[: len(names)]
    return tuple(
        Term(
            name,
            float(fitted.fe_params[place]),
            float(fitted.bse_fe[place]),
            float(fitted.tvalues[place]),
            float(fitted.pvalues[place]),
            float(bounds[place, 0]),
            float(bounds[place, 1]),
        )
        for place, name in enumerate(names)
    )


def _remarks(group_variance: float, residual: float, warned: Sequence[str]) -> tuple[str, ...]:
    remarks = []
    if group_variance <= _SMALL * residual:
        remarks.append("The participants' variance is estimated as zero.")
    elif any("boundary" in text or "singular" in text for text in warned):
        remarks.append("The estimate lies near the boundary of what is possible.")
    return tuple(remarks)
