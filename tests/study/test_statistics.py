"""Statistics against published worked examples, and against truths that were planted."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.study.statistics.intervals import (
    FEWEST_TO_RESAMPLE,
    bootstrap_mean,
    mean_interval,
    means_by_unit,
    wilson_interval,
)
from tams_app.study.statistics.mixed_model import (
    INTERCEPT,
    MixedModel,
    NotFitted,
    fit_mixed_model,
    interaction_columns,
)
from tams_app.study.statistics.pairs import paired_difference
from tams_app.study.statistics.welch import cohens_d, stars, welch

pytestmark = pytest.mark.untimed

# Student (1908), "The probable error of a mean", Biometrika 6: additional hours of sleep by two
# drugs; R's `sleep`. R's documentation of t.test and effectsize work it through.
DRUG_1 = [0.7, -1.6, -0.2, -1.2, -0.1, 3.4, 3.7, 0.8, 0.0, 2.0]
DRUG_2 = [1.9, 0.8, 1.1, 0.1, -0.1, 4.4, 5.5, 1.6, 4.6, 3.4]

# Darwin's maize (1876): cross- minus self-fertilised plants, eighths of an inch. Fisher (1935),
# The Design of Experiments, section 17: mean 20.93, t = 2.148; 95 % limits 0.03 and 41.84.
MAIZE = [49, -67, 8, 16, 6, 23, 28, 41, 14, 29, 56, 24, 75, 60, -48]


def test_welch_s_t_is_that_of_the_published_sleep_example() -> None:
    found = welch(DRUG_1, DRUG_2)
    assert found is not None
    assert found.t == pytest.approx(-1.8608, abs=5e-5)
    assert found.df == pytest.approx(17.776, abs=5e-4)
    assert found.p == pytest.approx(0.07939, abs=5e-6)
    assert (found.low, found.high) == pytest.approx((-3.3654832, 0.2054832), abs=5e-7)
    assert found.difference == pytest.approx(0.75 - 2.33)


def test_cohen_s_d_is_that_of_the_published_sleep_example() -> None:
    assert cohens_d(DRUG_1, DRUG_2) == pytest.approx(-0.83, abs=5e-3)
    assert cohens_d([2, 4], [1, 3]) == pytest.approx(1 / np.sqrt(2))  # by hand
    assert cohens_d([1, 1], [1, 1]) is None
    assert cohens_d([1], [1, 2]) is None


def test_welch_needs_values_and_variance() -> None:
    assert welch([1], [1, 2, 3]) is None
    assert welch([2, 2], [3, 3]) is None


def test_stars_are_those_of_the_paper() -> None:
    assert [stars(p) for p in (0.05, 0.049, 0.0099, 0.00099)] == ["ns", "*", "**", "***"]


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
    assert found is not None
    assert (found.low, found.high) == pytest.approx((low, high), abs=5e-5)
    assert found.value == successes / n


def test_the_t_interval_is_that_of_fisher_s_maize() -> None:
    found = mean_interval(MAIZE)
    assert found is not None
    assert (found.value, found.low, found.high) == pytest.approx((20.93, 0.03, 41.84), abs=5e-3)
    assert found.excludes_zero
    one = mean_interval([3.0])
    assert one is not None
    assert (one.value, one.low, one.high, one.excludes_zero) == (3.0, None, None, False)
    assert mean_interval([]) is None
    assert wilson_interval(0, 0) is None


def test_the_bootstrap_interval_of_the_maize_lies_where_the_t_interval_does() -> None:
    found = bootstrap_mean(MAIZE)
    assert found is not None
    assert found.low is not None
    assert found.high is not None
    assert found.value == pytest.approx(20.93, abs=5e-3)
    assert found.low == pytest.approx(0.03, abs=6)
    assert found.high == pytest.approx(41.84, abs=6)
    assert found == bootstrap_mean(MAIZE)  # seeded
    assert found != bootstrap_mean(MAIZE, seed=1)


def test_the_bootstrap_covers_the_truth_about_as_often_as_it_says() -> None:
    random = np.random.default_rng(1)
    hits = 0
    for _ in range(40):
        found = bootstrap_mean(random.normal(3, 1, 25).tolist())
        assert found is not None
        assert found.low is not None
        assert found.high is not None
        hits += found.low <= 3 <= found.high
    assert 34 <= hits <= 40


@given(st.lists(st.floats(0.1, 9), min_size=1, max_size=FEWEST_TO_RESAMPLE - 1))
def test_a_handful_of_units_never_excludes_zero(values: list[float]) -> None:
    found = bootstrap_mean(values)
    assert found is not None
    assert not found.excludes_zero


def test_values_that_never_vary_have_an_interval_without_width() -> None:
    found = bootstrap_mean([0.0] * 8)
    assert found is not None
    assert (found.low, found.high, found.excludes_zero) == (0.0, 0.0, False)
    assert bootstrap_mean([]) is None


def test_repetitions_count_once_per_participant() -> None:
    assert means_by_unit({"P01": [1, 3], "P02": [5], "P03": []}) == [2.0, 5.0]


def test_pairs_are_made_within_participant_and_the_rest_is_counted() -> None:
    first = {(f"P{n:02}", r): 10.0 + n + r for n in range(8) for r in (1, 2)}
    second = {key: value - 2.0 for key, value in first.items()}
    del first[("P03", 1)]
    second[("P99", 1)] = 0.0
    found = paired_difference(first, second)
    assert (found.pairs, found.unpaired) == (15, 2)
    assert found.estimate is not None
    assert (found.estimate.value, found.estimate.n) == (2.0, 8)
    assert paired_difference({}, second).estimate is None


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
    columns = {one: [float(kind == one) for kind in types] for one in ("T2", "T3", "T4")}
    model = fit_mixed_model(efforts, columns, subjects)
    assert isinstance(model, MixedModel)
    betas = [term.beta for term in model.terms]
    assert betas == pytest.approx([8.555556, 3.888889, 2.222222, 0.666667], abs=1e-5)
    assert model.term(INTERCEPT).standard_error == pytest.approx(0.5760123, abs=1e-4)
    assert model.term("T2").standard_error == pytest.approx(0.5186838, abs=1e-4)
    assert model.group_sd == pytest.approx(1.332465, abs=1e-3)
    assert model.residual_sd == pytest.approx(1.100295, abs=1e-4)
    assert (model.n, model.groups) == (36, 9)


# Pinheiro & Bates (2000), section 1.1: `Rail`, travel time of ultrasonic waves in six rails (REML).
RAIL = [(55, 53, 54), (26, 37, 32), (78, 91, 85), (92, 100, 96), (49, 51, 50), (80, 85, 83)]


def test_the_mixed_model_is_that_of_the_published_rail_example() -> None:
    times = [float(time) for row in RAIL for time in row]
    model = fit_mixed_model(times, {}, [f"R{number}" for number in range(6) for _ in range(3)])
    assert isinstance(model, MixedModel)
    assert model.term(INTERCEPT).beta == pytest.approx(66.5, abs=1e-4)
    assert model.term(INTERCEPT).standard_error == pytest.approx(10.17104, abs=2e-2)
    assert model.group_sd == pytest.approx(24.80547, abs=5e-2)
    assert model.residual_sd == pytest.approx(4.020779, abs=1e-3)


def planted(interaction_s: float, people: int, sigma: float) -> MixedModel | NotFitted:
    random = np.random.default_rng(4)
    strategies, networks, groups, times = [], [], [], []
    for person in range(people):
        offset = random.normal(0, 4)
        for strategy in ("equal", "tams"):
            for network in ("s1", "s3"):
                both = interaction_s * (strategy == "tams" and network == "s3")
                strategies.append(strategy)
                networks.append(network)
                groups.append(f"P{person}")
                times.append(25 + 30 * (network == "s3") + both + offset + random.normal(0, sigma))
    columns = interaction_columns(strategies, networks, ("equal", "tams"), ("s1", "s3"))
    return fit_mixed_model(times, columns, groups)


def test_a_planted_interaction_is_found_and_none_is_not() -> None:
    found = planted(-20.0, 16, 6)
    assert isinstance(found, MixedModel)
    term = found.term("tams × s3")
    assert term.low < -20 < term.high
    assert term.p < 0.001
    none = planted(0.0, 16, 6)
    assert isinstance(none, MixedModel)
    assert none.term("tams × s3").p > 0.05


def test_a_model_that_cannot_be_says_why() -> None:
    reasons = [
        fit_mixed_model([1, 2, 3], {}, ["P1"] * 3),
        fit_mixed_model([1, 2, 3], {"a": [0, 1, 0]}, ["P1", "P2", "P1"]),
        fit_mixed_model([1, 2, 3, 4, 5], {"a": [0] * 5}, ["P1", "P2", "P1", "P2", "P1"]),
        fit_mixed_model([2.0] * 6, {}, ["P1", "P2"] * 3),
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
    model = fit_mixed_model(values.tolist(), {}, groups)
    assert isinstance(model, MixedModel)
    assert model.group_sd < 0.05
    assert model.remarks
