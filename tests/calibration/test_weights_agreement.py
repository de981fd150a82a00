"""Agreement between raters, against published worked examples."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from calibration.weights.fit import kendall_w, krippendorff_alpha

pytestmark = pytest.mark.untimed

N = np.nan
# Krippendorff (2011): four observers, twelve units, some values missing
KRIPPENDORFF = np.array(
    [
        [1, 2, 3, 3, 2, 1, 4, 1, 2, N, N, N],
        [1, 2, 3, 3, 2, 2, 4, 1, 2, 5, N, 3],
        [N, 3, 3, 3, 2, 3, 4, 2, 2, 5, 1, N],
        [1, 2, 3, 3, 2, 4, 4, 1, 2, 5, 1, N],
    ]
)
# Siegel (1956), chapter 9: three executives rank six applicants
EXECUTIVES = np.array([[1, 6, 3, 2, 5, 4], [1, 5, 6, 4, 2, 3], [6, 3, 2, 5, 4, 1]], float)
# the same chapter: three rankings of ten things, with ties
TIED = np.array(
    [
        [1, 4.5, 2, 4.5, 3, 7.5, 6, 9, 7.5, 10],
        [2.5, 1, 2.5, 4.5, 4.5, 8, 9, 6.5, 10, 6.5],
        [2, 1, 4.5, 4.5, 4.5, 4.5, 8, 8, 8, 10],
    ]
)


@pytest.mark.parametrize(("metric", "published"), [("nominal", 0.743), ("ordinal", 0.815)])
def test_alpha_is_what_krippendorff_computes_for_his_example(metric, published):
    assert krippendorff_alpha(KRIPPENDORFF, metric) == pytest.approx(published, abs=5e-4)


ratings = arrays(
    np.float64,
    st.tuples(st.integers(2, 5), st.integers(2, 6)),
    elements=st.sampled_from([1.0, 2.0, 3.0, 4.0, 5.0, N]),
)


@given(ratings, st.permutations([0, 1, 2, 3, 4]))
def test_renaming_categories_leaves_the_nominal_alpha_and_stretching_a_scale_the_ordinal_one(
    values, order
):
    given_ = np.isfinite(values)
    renamed, stretched = values.copy(), values.copy()
    renamed[given_] = np.array(order)[values[given_].astype(int) - 1]
    stretched[given_] = values[given_] ** 3
    for metric, changed in (("nominal", renamed), ("ordinal", stretched)):
        before = krippendorff_alpha(values, metric)
        assert krippendorff_alpha(changed, metric) == (
            None if before is None else pytest.approx(before, abs=1e-9)
        )


@pytest.mark.parametrize("values", [np.full((3, 4), 2.0), np.array([[1.0, N], [N, 2.0]])])
def test_alpha_is_undefined_without_variation_or_without_a_unit_rated_twice(values):
    assert krippendorff_alpha(values, "ordinal") is None


@pytest.mark.parametrize(
    ("ranks", "published", "within"), [(EXECUTIVES, 0.16, 5e-3), (TIED, 0.828, 5e-4)]
)
def test_kendalls_w_is_what_siegel_computes_also_with_ties(ranks, published, within):
    assert kendall_w(ranks) == pytest.approx(published, abs=within)


def test_kendalls_w_leaves_out_a_rater_who_did_not_rate_everything():
    incomplete = np.vstack([TIED, [N, *range(9)]])
    assert kendall_w(incomplete) == kendall_w(TIED)


def test_kendalls_w_is_undefined_for_one_rater_and_where_nobody_distinguishes():
    assert kendall_w(TIED[:1]) is None
    assert kendall_w(np.full((4, 3), 3.0)) is None


@given(ratings)
def test_kendalls_w_is_between_zero_and_one(values):
    found = kendall_w(values)
    assert found is None or -1e-12 <= found <= 1 + 1e-12
