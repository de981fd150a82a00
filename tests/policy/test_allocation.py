"""The allocation rule and the strategies."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.config import load_config
from tams_app.errors import ConfigError
from tams_app.policy.allocation import STRATEGIES, ladder
from tams_app.policy.strategy import allocate
from tams_app.policy.weights import WeightMatrix
from tams_app.records import Phase

pytestmark = pytest.mark.untimed

POLICY = load_config().policy
budgets = st.one_of(st.floats(0, 50_000), st.sampled_from([0, 1, 449, 449.999, 450, 450.001]))
floors = st.one_of(st.just(150.0), st.floats(0, 1000))


@st.composite
def weight_rows(draw):
    parts = draw(st.lists(st.integers(0, 100), min_size=1, max_size=6).filter(any))
    return {f"v{i}": part / sum(parts) for i, part in enumerate(parts)}


@given(weight_rows(), budgets, floors)
def test_the_sum_never_exceeds_the_budget_and_loses_less_than_a_kbit_per_view(
    weights, budget, floor
):
    targets = allocate(weights, budget, floor)
    assert sum(targets.values()) <= budget
    assert sum(targets.values()) > budget - len(weights) - 1e-6


@given(weight_rows(), budgets, floors)
def test_every_view_keeps_the_floor_when_the_budget_allows_it(weights, budget, floor):
    targets = allocate(weights, budget, floor)
    if budget >= len(weights) * floor:
        assert all(target >= int(floor) for target in targets.values())
    else:
        assert len(set(targets.values())) == 1


@given(weight_rows(), budgets, budgets, floors)
def test_more_budget_never_means_less_for_any_view(weights, one, other, floor):
    less, more = sorted((one, other))
    small, large = allocate(weights, less, floor), allocate(weights, more, floor)
    assert all(small[view] <= large[view] for view in weights)


def test_weights_that_are_exact_decimals_are_not_rounded_below_their_share():
    assert allocate({"a": 0.1, "b": 0.2, "c": 0.7}, 1000, 0) == {"a": 100, "b": 200, "c": 700}


def test_equal_gives_the_same_to_all_and_static_never_changes():
    equal, static = STRATEGIES["equal"](POLICY), STRATEGIES["static"](POLICY)
    for phase in Phase:
        assert len(set(allocate(equal.weights(phase), 5520, 150).values())) == 1
        assert static.weights(phase) == {"eih": 0.5, "gt": 0.25, "gs": 0.25}


def test_tams_gives_most_to_the_primary_view_of_each_phase():
    tams, matrix = STRATEGIES["tams"](POLICY), WeightMatrix(POLICY.weights.matrix)
    for phase in Phase:
        targets = allocate(tams.weights(phase), 5520, 150)
        assert max(targets, key=targets.__getitem__) == matrix.primary_view(phase)


def test_the_primary_views_are_those_of_table_one():
    matrix = WeightMatrix(POLICY.weights.matrix)
    primary = [matrix.primary_view(phase) for phase in Phase]
    assert primary == ["gt", "eih", "eih", "gs", "eih", "eih"]


@pytest.mark.parametrize("phase", Phase)
@pytest.mark.parametrize("name", STRATEGIES)
def test_every_strategy_shares_all_of_the_bits_among_all_views(name, phase):
    shares = STRATEGIES[name](POLICY).weights(phase)
    assert set(shares) == set(POLICY.allocation.static_weights)
    assert min(shares.values()) >= 0.0
    assert sum(shares.values()) == pytest.approx(1.0)


def test_an_unknown_strategy_is_refused_with_the_names_that_exist():
    with pytest.raises(ConfigError) as refused:
        STRATEGIES["best"](POLICY)
    assert str(refused.value).endswith(f"'best' is not one of {', '.join(STRATEGIES)}")


def test_what_a_caller_does_to_the_targets_changes_no_later_ones():
    first = allocate({"EIH": 0.6, "GT": 0.4}, 5000.0, 400.0)
    expected = dict(first)
    first["EIH"] = 0
    assert allocate({"EIH": 0.6, "GT": 0.4}, 5000.0, 400.0) == expected


def test_a_pinned_view_is_primary_and_has_the_row_in_which_it_is_or_its_largest_share() -> None:
    matrix = WeightMatrix(POLICY.weights.matrix)
    assert [matrix.primary_view(phase, "eih") for phase in Phase] == ["eih"] * len(Phase)
    assert matrix.row_phase(Phase.REACH, "eih") is Phase.ALIGN
    assert matrix.row_phase(Phase.PRE_RELEASE, "eih") is Phase.PRE_RELEASE  # primary already
    assert matrix.row_phase(Phase.ALIGN, "gs") is Phase.TRANSPORT
    for unpinned in ("", "none of them"):
        assert [matrix.primary_view(phase, unpinned) for phase in Phase] == [
            matrix.primary_view(phase) for phase in Phase
        ]
        assert [matrix.row_phase(phase, unpinned) for phase in Phase] == [*Phase]
    never = {phase: {"a": 0.7, "b": 0.3} for phase in Phase}
    never[Phase.GRASP] = {"a": 0.55, "b": 0.45}
    assert WeightMatrix(never).row_phase(Phase.REACH, "b") is Phase.GRASP


@st.composite
def matrices(draw: st.DrawFn) -> WeightMatrix:
    views = draw(st.integers(1, 4))
    row = st.lists(st.integers(0, 100), min_size=views, max_size=views).filter(any)
    parts = {phase: draw(row) for phase in Phase}
    return WeightMatrix(
        {
            phase: {f"v{i}": part / sum(row) for i, part in enumerate(row)}
            for phase, row in parts.items()
        }
    )


@given(
    matrices(),
    st.sampled_from(Phase),
    st.sampled_from(["", "v0", "v1", "v2", "v3", "nonsense"]),
)
def test_whatever_is_pinned_its_row_is_one_of_the_matrix(
    matrix: WeightMatrix, phase: Phase, pinned: str
) -> None:
    row = matrix.row(matrix.row_phase(phase, pinned))
    primary = matrix.primary_view(phase, pinned)
    assert row in [matrix.row(one) for one in Phase]
    assert primary == (pinned if pinned in row else matrix.primary_view(phase))
    if any(matrix.primary_view(one) == primary for one in Phase):
        assert row[primary] == max(row.values())
    else:
        assert row[primary] == max(matrix.row(one)[primary] for one in Phase)


# --- what `tams+` adds to `tams` -----------------------------------------------------------------

FLOORS_KBPS = 450.0
TAMS, PLUS = STRATEGIES["tams"](POLICY), STRATEGIES["tams+"](POLICY)
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
    assert targets[WeightMatrix(POLICY.weights.matrix).primary_view(phase)] == max(targets.values())
    if budget >= 75:
        assert min(targets.values()) >= 25


@given(phases, st.floats(0, 20_000), st.floats(0, 20_000))
def test_more_budget_means_less_for_no_view_of_tams_plus(phase, one, other):
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
