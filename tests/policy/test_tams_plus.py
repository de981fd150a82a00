"""What `tams+` adds to `tams`."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.config import load_config
from tams_app.policy.allocation import ladder, make_strategy
from tams_app.policy.weights import WeightMatrix
from tams_app.records import Phase
from tests.policy.test_allocation import weight_rows

pytestmark = pytest.mark.untimed

POLICY = load_config().policy
MATRIX = WeightMatrix(POLICY.weights.matrix)
FLOORS_KBPS = 450.0
TAMS, PLUS = make_strategy("tams", POLICY), make_strategy("tams+", POLICY)

phases = st.sampled_from(list(Phase))
small_budgets = st.floats(0, FLOORS_KBPS, exclude_max=True)


@given(phases, st.floats(FLOORS_KBPS, 20_000))
def test_from_the_sum_of_floors_on_it_is_tams(phase, budget):
    assert PLUS.targets(phase, budget) == TAMS.targets(phase, budget)


@given(phases, small_budgets)
def test_below_the_floors_the_primary_view_goes_down_last(phase, budget):
    targets = PLUS.targets(phase, budget)
    assert sum(targets.values()) <= budget
    assert max(targets.values()) <= 150
    assert targets[MATRIX.primary_view(phase)] == max(targets.values())
    if budget >= 75:
        assert min(targets.values()) >= 25


@given(phases, st.floats(0, 20_000), st.floats(0, 20_000))
def test_more_budget_never_means_less_for_any_view(phase, one, other):
    less, more = (PLUS.targets(phase, budget) for budget in sorted((one, other)))
    assert all(less[view] <= more[view] for view in less)


@given(weight_rows(), st.floats(0, 1))
def test_below_the_floors_bits_stay_unused_only_where_no_view_may_have_them(weights, share):
    budget = share * 150 * len(weights)
    targets = ladder(weights, budget, 150)
    full = all(targets[view] == 150 for view, weight in weights.items() if weight)
    assert sum(targets.values()) <= budget
    assert full or sum(targets.values()) > budget - len(weights) - 1e-6


def test_what_the_floor_keeps_from_one_view_the_others_divide_by_their_weights():
    weights = {"gs": 0.1, "eih": 0.7, "gt": 0.2}
    assert ladder(weights, 275, 150) == {"gs": 50, "eih": 150, "gt": 75}
    assert ladder(weights, 175, 150) == {"gs": 35, "eih": 95, "gt": 45}
    assert ladder(weights, 60, 150) == {"gs": 20, "eih": 20, "gt": 20}


def test_the_ladder_leaves_out_frames_where_a_view_has_less_than_the_floor():
    assert PLUS.source_drop_below_kbps == 150
    assert TAMS.source_drop_below_kbps == 80


@given(phases)
def test_at_the_sum_of_floors_the_ladder_meets_the_rule_above_it(phase):
    below = PLUS.targets(phase, FLOORS_KBPS - 0.001)
    assert all(target in (149, 150) for target in below.values())
