"""Water-filling: bounds for each view, the rest by share."""

from fractions import Fraction

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.policy.sharing import Demand, allocate, pour

pytestmark = pytest.mark.untimed

rates = st.one_of(st.integers(0, 5000), st.floats(0, 5000)).map(Fraction)
budgets = st.floats(0, 20_000)
names = st.sampled_from(["eih", "gt", "gs", "left", "right"])


@st.composite
def demand(draw):
    least, most = sorted((draw(rates), draw(rates)))
    return Demand(draw(rates), draw(rates), least, most)


demands = st.dictionaries(names, demand(), min_size=1)


def least(views):
    return sum(demand.at(Fraction(0)) for demand in views.values())


@given(budgets, demands)
def test_the_sum_never_exceeds_the_budget(budget, views):
    assert sum(pour(budget, views).values()) <= budget


@given(budgets, demands)
def test_no_view_gets_more_than_it_can_use_and_none_less_than_its_least(budget, views):
    targets = pour(budget, views)
    for view, one in views.items():
        assert targets[view] <= one.most
        assert targets[view] >= int(one.least) or budget < least(views)


@given(budgets, demands)
def test_bits_stay_unused_only_where_no_view_may_have_them(budget, views):
    targets = pour(budget, views)
    unused = budget - sum(targets.values())
    full = all(targets[v] == int(one.most) for v, one in views.items() if one.share)
    assert full or unused < len(views) + 1e-6


@given(budgets, budgets, demands)
def test_more_budget_never_means_less_for_any_view(one, other, views):
    less, more = sorted((one, other))
    small, large = pour(less, views), pour(more, views)
    assert all(small[view] <= large[view] for view in views)


@given(st.floats(450, 20_000), st.lists(st.integers(0, 100), min_size=3, max_size=3).filter(any))
def test_without_bounds_it_is_the_paper_s_rule(budget, parts):
    weights = {f"v{i}": part / sum(parts) for i, part in enumerate(parts)}
    floor = Fraction(150)
    views = {
        view: Demand(Fraction(str(weight)), floor, floor, Fraction(budget))
        for view, weight in weights.items()
    }
    assert pour(budget, views) == allocate(weights, budget, 150)


def test_what_one_view_may_not_have_goes_to_the_others_by_their_shares():
    base, most = Fraction(100), Fraction(10_000)
    views = {
        "a": Demand(Fraction(2), base, base, Fraction(400)),
        "b": Demand(Fraction(2), base, base, most),
        "c": Demand(Fraction(1), base, base, most),
    }
    assert pour(1500, views) == {"a": 400, "b": 700, "c": 400}
