"""What `tams+` adds to `tams`, part by part."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.config import load_config
from tams_app.policy.allocation import make_strategy
from tams_app.policy.phases import Foreseen
from tams_app.policy.strategy import Situation
from tams_app.policy.tams_plus import FINEST_QP, FORESEEN_SHARE
from tams_app.policy.weights import WeightMatrix
from tams_app.records import CodedFrame, Phase

pytestmark = pytest.mark.untimed

PARTS = ("redistribution", "lookahead", "ladder")
VIEWS = ("eih", "gt", "gs")
MATRIX = WeightMatrix(load_config().policy.weights.matrix)
MS = 1_000_000
FRAME_NS = 33 * MS
FLOORS_KBPS = 450.0

phases = st.sampled_from(list(Phase))
budgets = st.floats(FLOORS_KBPS, 20_000)
small_budgets = st.floats(0, FLOORS_KBPS)
qps = st.fixed_dictionaries({view: st.integers(0, 51) for view in VIEWS})
rates = st.fixed_dictionaries({view: st.floats(10, 20_000) for view in VIEWS})


def strategy(*parts):
    """`tams+` with these of its parts alone."""
    keys = {f"policy.tams_plus.{part}": part in parts for part in PARTS}
    return make_strategy("tams+", load_config(None, keys).policy)


def tams(phase, budget):
    plain = make_strategy("tams", load_config().policy)
    return plain.targets(Situation(0, phase, budget))


def coded(kbps, qp, now_ns=0):
    """The frames of the last 300 ms of each view, all alike."""
    return tuple(
        CodedFrame(view, now_ns - age * FRAME_NS, round(kbps[view] * 33 / 8), qp[view])
        for view in VIEWS
        for age in range(8, -1, -1)
    )


def test_no_strategy_but_this_one_has_the_qp_read_and_only_for_the_part_that_uses_it():
    for name in ("equal", "static", "tams"):
        assert not make_strategy(name, load_config().policy).reads_qp
    assert {part for part in PARTS if strategy(part).reads_qp} == {"redistribution"}


@given(phases, st.floats(0, 20_000), rates, qps)
def test_without_its_parts_it_is_tams(phase, budget, kbps, qp):
    situation = Situation(0, phase, budget, Foreseen(Phase.ALIGN, 0.9), coded(kbps, qp))
    assert strategy().targets(situation) == tams(phase, budget)


@given(phases, budgets)
def test_without_figures_of_the_encoders_it_is_tams(phase, budget):
    assert strategy(*PARTS).targets(Situation(0, phase, budget)) == tams(phase, budget)


@given(phases, budgets, rates)
def test_streams_that_do_not_tell_their_qp_leave_it_tams(phase, budget, kbps):
    situation = Situation(0, phase, budget, None, coded(kbps, dict.fromkeys(VIEWS)))
    assert strategy(*PARTS).targets(situation) == tams(phase, budget)


def test_figures_of_long_ago_count_no_more():
    chosen = strategy("redistribution")
    old = coded(dict.fromkeys(VIEWS, 1000), {"eih": 40, "gt": 20, "gs": 10})
    assert chosen.targets(Situation(0, Phase.REACH, 5520, None, old)) != tams(Phase.REACH, 5520)
    assert chosen.targets(Situation(1000 * MS, Phase.REACH, 5520)) == tams(Phase.REACH, 5520)


@pytest.mark.parametrize("parts", [("redistribution",), PARTS])
@given(phases, budgets, rates, qps)
def test_the_sum_and_the_floors_hold_and_the_primary_view_never_pays(
    parts, phase, budget, kbps, qp
):
    targets = strategy(*parts).targets(Situation(0, phase, budget, None, coded(kbps, qp)))
    assert sum(targets.values()) <= budget
    assert min(targets.values()) >= 150
    primary = MATRIX.primary_view(phase)
    assert targets[primary] >= tams(phase, budget)[primary]


@pytest.mark.parametrize("parts", [("redistribution",), PARTS])
@given(phases, st.floats(0, 20_000), st.floats(0, 20_000), rates, qps)
def test_more_budget_never_means_less_for_any_view(parts, phase, one, other, kbps, qp):
    less, more = (
        strategy(*parts).targets(Situation(0, phase, budget, None, coded(kbps, qp)))
        for budget in sorted((one, other))
    )
    assert all(less[view] <= more[view] for view in VIEWS)


def test_a_view_that_is_fine_enough_gives_its_bits_to_the_others():
    kbps = {"eih": 3000, "gt": 1100, "gs": 1100}
    frames = coded(kbps, {"eih": 24, "gt": 24, "gs": FINEST_QP - 6})
    targets = strategy("redistribution").targets(Situation(0, Phase.ALIGN, 5520, None, frames))
    assert targets["gs"] == pytest.approx(550, rel=0.02)  # half, six steps of QP coarser
    assert targets["eih"] > 3192
    assert targets["gt"] > 1164
    assert sum(targets.values()) > 5517


def test_bits_that_no_view_can_use_are_left_to_the_link():
    frames = coded(dict.fromkeys(VIEWS, 1000), dict.fromkeys(VIEWS, FINEST_QP))
    targets = strategy("redistribution").targets(Situation(0, Phase.ALIGN, 20_000, None, frames))
    assert targets["gt"] == pytest.approx(1000, rel=0.02)
    assert targets["eih"] == tams(Phase.ALIGN, 20_000)["eih"]


@given(phases, phases, st.floats(0.01, 0.98), st.floats(0.01, 0.98))
def test_the_foreseen_phase_s_primary_view_is_raised_as_its_timer_runs(phase, next_, one, other):
    chosen = strategy("lookahead")
    early, late = (
        chosen.targets(Situation(0, phase, 5520, Foreseen(next_, progress)))
        for progress in sorted((one, other))
    )
    now, then = tams(phase, 5520), tams(next_, 5520)
    for view in VIEWS:
        low, high = sorted((now[view], then[view]))
        assert low - 1 <= late[view] <= high + 1
        assert abs(late[view] - now[view]) <= FORESEEN_SHARE * (high - low) + 2
        assert abs(late[view] - now[view]) >= abs(early[view] - now[view]) - 1


@given(phases, small_budgets)
def test_below_the_floors_the_primary_view_goes_down_last(phase, budget):
    targets = strategy("ladder").targets(Situation(0, phase, budget))
    assert sum(targets.values()) <= budget
    assert max(targets.values()) <= 150
    assert targets[MATRIX.primary_view(phase)] == max(targets.values())
    if budget >= 75:
        assert min(targets.values()) >= 25


def test_the_ladder_leaves_out_frames_where_a_view_has_less_than_the_floor():
    assert strategy("ladder").source_drop_below_kbps == 150
    assert strategy().source_drop_below_kbps == 80


@given(phases)
def test_at_the_sum_of_floors_the_ladder_meets_the_rule_above_it(phase):
    below = strategy("ladder").targets(Situation(0, phase, FLOORS_KBPS - 0.001))
    assert all(target in (149, 150) for target in below.values())
