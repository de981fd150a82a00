"""Statistics against published worked examples, and against truths that were planted."""

from __future__ import annotations

import numpy as np
import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.study.statistics import (
    FEWEST_TO_TEST,
    MixedModel,
    NotFitted,
    PairedDifference,
    Term,
    cohens_d,
    fit_mixed_model,
    mean_interval,
    paired_difference,
    welch,
    wilson_interval,
)

pytestmark = pytest.mark.untimed


def effect(model: MixedModel, name: str) -> Term:
    """The fixed effect of that name."""
    return next(one for one in model.terms if one.name == name)


# Student (1908), "The probable error of a mean", Biometrika 6: additional hours of sleep by two
# drugs; R's `sleep`. R's documentation of t.test and effectsize work it through.
DRUG_1 = [0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0]
DRUG_2 = [1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4]

# Darwin's maize (1876): cross- minus self-fertilised plants, eighths of an inch. Fisher (1935),
# The Design of Experiments, section 17: mean 20.93, t = 2.148; 95 % limits 0.03 and 41.84.
MAIZE = [49, -67, 8, 16, 6, 23, 28, 41, 14, 29, 56, 24, 75, 60, -48]


def test_welch_s_t_is_that_of_the_published_sleep_example() -> None:
    found = welch(DRUG_1, DRUG_2)
    assert found.t == pytest.approx(-1.8608, abs=5e-5)
    assert found.df == pytest.approx(17.776, abs=5e-4)
    assert found.p == pytest.approx(0.07939, abs=5e-6)
    ends = (found.difference.low, found.difference.high)
    assert ends == pytest.approx((-3.3654832, 0.2054832), abs=5e-7)
    assert found.difference.value == pytest.approx(0.75 - 2.33)


def test_cohen_s_d_is_that_of_the_published_sleep_example() -> None:
    assert cohens_d(DRUG_1, DRUG_2) == pytest.approx(-0.83, abs=5e-3)
    assert cohens_d([2, 4], [1, 3]) == pytest.approx(1 / np.sqrt(2))  # by hand
    assert cohens_d([1, 1], [1, 1]) is None
    assert cohens_d([1], [1, 2]) is None


def test_welch_needs_values_and_variance() -> None:
    assert welch([1], [1, 2, 3]) is None
    assert welch([2, 2], [3, 3]) is None


# Newcombe (1998), "Two-sided confidence intervals for the single proportion", Statistics in
# Medicine 17, 857–872, table I, method 3.
@pytest.mark.parametrize(
    ("successes", "n", "low", "high"),
    [
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0, 0.1611),
        (1, 29, 0.0061, 0.1718),
    ],
)
def test_wilson_s_interval_is_that_of_newcombe(
    successes: int, n: int, low: float, high: float
) -> None:
    found = wilson_interval(successes, n)
    assert (found.low, found.high) == pytest.approx((low, high), abs=5e-5)
    assert found.value == successes / n


def test_the_t_interval_is_that_of_fisher_s_maize() -> None:
    found = mean_interval(MAIZE)
    assert (found.value, found.low, found.high) == pytest.approx((20.93, 0.03, 41.84), abs=5e-3)
    one = mean_interval([3.0])
    assert (one.value, one.low, one.high) == (3.0, None, None)
    assert mean_interval([]) is None
    assert wilson_interval(0, 0) is None


def paired(differences: list[float]) -> PairedDifference:
    """One pair for each participant."""
    index = pd.MultiIndex.from_tuples([(f"P{n:02}", 1) for n in range(len(differences))])
    first = pd.Series(differences, index=index, dtype=float)
    return paired_difference(first, first * 0.0)


def test_the_paired_t_test_is_that_of_fisher_s_maize() -> None:
    found = paired([float(one) for one in MAIZE])
    assert found.p == pytest.approx(0.0497, abs=5e-5)  # as R's t.test gives it
    assert found.is_shown
    assert found.estimate == mean_interval(MAIZE)
    assert not paired([float(one) for one in MAIZE[:14]] + [-60.0]).is_shown


def test_interval_and_test_say_the_same() -> None:
    random = np.random.default_rng(1)
    found = [paired(random.normal(0.4, 1, 12).tolist()) for _ in range(100)]
    for one in found:
        assert one.is_shown == (one.estimate.low > 0 or one.estimate.high < 0)
    assert 10 < sum(one.is_shown for one in found) < 60


@given(st.lists(st.floats(0.1, 9), min_size=1, max_size=FEWEST_TO_TEST - 1))
def test_a_handful_of_participants_shows_nothing(values: list[float]) -> None:
    found = paired(values)
    assert (found.is_shown, found.p) == (False, None)
    assert found.estimate.low is None


def test_differences_that_never_vary_are_all_or_nothing() -> None:
    assert not paired([0.0] * 8).is_shown
    assert paired([0.5] * 8).is_shown


def test_pairs_are_made_within_participant_and_the_rest_is_counted() -> None:
    first = {(f"P{n:02}", r): 10.0 + n + r for n in range(8) for r in (1, 2)}
    second = {key: value - 2.0 for key, value in first.items()}
    del first[("P03", 1)]
    second[("P99", 1)] = 0.0
    found = paired_difference(pd.Series(first), pd.Series(second))
    assert (found.pairs, found.unpaired) == (15, 2)
    assert (found.estimate.value, found.estimate.n) == (2.0, 8)


def test_repetitions_count_once_per_participant() -> None:
    first = {("P01", 1): 1.0, ("P01", 2): 3.0, ("P02", 1): 5.0}
    found = paired_difference(pd.Series(first), pd.Series(first) * 0.0)
    assert (found.estimate.value, found.estimate.n) == (3.5, 2)


# Pinheiro & Bates (2000), Mixed-Effects Models in S and S-PLUS, section 1.2: `ergoStool`, effort to
# arise from four types of stool by nine subjects (REML, treatment contrasts).
ERGO_STOOL = [
    (12, 15, 12, 10),
    (10, 14, 13, 12),
    (7, 14, 13, 9),
    (7, 11, 10, 9),
    (8, 11, 8, 7),
    (9, 11, 11, 10),
    (8, 12, 12, 11),
    (7, 11, 8, 7),
    (9, 13, 10, 8),
]


def test_the_mixed_model_is_that_of_the_published_ergo_stool_example() -> None:
    efforts = [float(effort) for row in ERGO_STOOL for effort in row]
    subjects = [f"S{number}" for number in range(9) for _ in range(4)]
    types = [f"T{number}" for _ in range(9) for number in range(1, 5)]
    rows = pd.DataFrame({"effort": efforts, "type": types, "participant": subjects})
    model = fit_mixed_model(rows, "effort ~ type")
    betas = [term.beta for term in model.terms]
    assert betas == pytest.approx([8.555556, 3.888889, 2.222222, 0.666667], abs=1e-5)
    assert effect(model, "Intercept").standard_error == pytest.approx(0.5760123, abs=1e-4)
    assert effect(model, "T2").standard_error == pytest.approx(0.5186838, abs=1e-4)
    assert model.group_sd == pytest.approx(1.332465, abs=1e-3)
    assert model.residual_sd == pytest.approx(1.100295, abs=1e-4)
    assert (model.n, model.groups) == (36, 9)


def test_a_model_that_cannot_be_says_why() -> None:
    def fit(values: list[float], columns: list[float], groups: str) -> MixedModel | NotFitted:
        rows = pd.DataFrame({"y": values, "x": columns, "participant": list(groups)})
        return fit_mixed_model(rows, "y ~ x")

    reasons = [
        fit([1, 2, 3], [0, 1, 0], "aaa"),
        fit([1, 2, 3], [0, 1, 0], "aba"),
        fit([1, 2, 3, 4, 5], [0] * 5, "ababa"),
        fit([2.0] * 6, [0, 1, 0, 1, 1, 0], "ababab"),
    ]
    sentences = [reason.reason for reason in reasons if isinstance(reason, NotFitted)]
    assert [text.split(":")[0][:40] for text in sentences] == [
        "The model needs at least two participant",
        "The model needs more than 3 trials; ther",
        "The model cannot be fitted",
        "The model cannot be fitted",
    ]


def test_participants_without_differences_are_remarked_and_not_an_error() -> None:
    random = np.random.default_rng(0)
    values = np.tile(random.normal(0, 1, 6), 8)  # each participant has exactly the same mean
    groups = [f"P{number}" for number in range(8) for _ in range(6)]
    model = fit_mixed_model(pd.DataFrame({"y": values, "participant": groups}), "y ~ 1")
    assert model.group_sd < 0.05
    assert model.remarks
