"""Where the capacity comes from."""

import math
from collections.abc import Callable

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tams_app.capacity import UnlimitedCapacity
from tams_app.config import load_config
from tams_app.policy.allocation import STRATEGIES, Policy
from tams_app.policy.budget import BUDGETS, OracleBudget
from tams_app.policy.budget.sender import SenderBudget
from tams_app.records import Phase, Reception, UplinkReport
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

POLICY = load_config().policy


class Falling:
    """A link that carries 1000 kbit/s until 5 s and 500 from then on."""

    def mean_kbps(self, start_ns, end_ns):
        def megabits_by(t_ns):
            return min(t_ns, 5000 * NS_PER_MS) * 1000 + max(0, t_ns - 5000 * NS_PER_MS) * 500

        return (megabits_by(end_ns) - megabits_by(start_ns)) / (end_ns - start_ns)


def test_the_oracle_sees_the_last_window_and_nothing_ahead():
    budget = OracleBudget(POLICY, Falling())
    assert budget.capacity_kbps(5000 * NS_PER_MS) == 1000
    assert budget.capacity_kbps(5050 * NS_PER_MS) == 750
    assert budget.capacity_kbps(5100 * NS_PER_MS) == 500


def test_without_a_bottleneck_the_oracle_gives_the_configured_maximum():
    budget = OracleBudget(POLICY, UnlimitedCapacity())
    assert budget.capacity_kbps(0) == 20_000


@pytest.mark.parametrize("made", [OracleBudget, SenderBudget])
def test_without_feedback_on_packets_no_padding_is_asked_for_and_nothing_bound(made):
    budget = made(POLICY, Falling())
    assert budget.padding_bytes(0) == 0
    assert budget.flight_limit_bytes(0) == math.inf


def test_every_mode_of_the_configuration_makes_its_budget():
    assert list(BUDGETS) == ["oracle", "sender", "feedback"]
    for mode in BUDGETS:
        policy = load_config(None, {"policy.budget.mode": mode}).policy
        assert mode in type(BUDGETS[mode](policy, UnlimitedCapacity())).__name__.lower()


def test_the_policy_applies_the_safety_factor_before_it_allocates():
    policy = Policy(STRATEGIES["tams"](POLICY), OracleBudget(POLICY, Falling()), POLICY)
    allocation = policy.step(Phase.ALIGN, UplinkReport(4000 * NS_PER_MS, 0))
    assert allocation.budget_kbps == pytest.approx(920)
    assert allocation.target_kbps == {"eih": 432, "gt": 244, "gs": 244}


# --- from sender statistics and receiver reports -------------------------------------------------

STEP_NS = 100 * NS_PER_MS
TRIP_NS = 90 * NS_PER_MS


def clean(_t_s: float, _kbps: float) -> Reception | None:
    return Reception("eih", 0.005, TRIP_NS, 3 * NS_PER_MS)


def run(
    answer: Callable[[float, float], Reception | None], seconds: float, bias: float = 1.0
) -> list[float]:
    """The estimate at each step; `answer` is each second's report on what was sent [kbit/s]."""
    budget, sent_bytes, estimates = SenderBudget(POLICY, UnlimitedCapacity()), 0.0, []
    for step in range(round(seconds * NS_PER_S / STEP_NS)):
        reception = None if step % 10 else answer(step / 10, budget.capacity_kbps(0) * 0.92 * bias)
        told = () if reception is None else (reception,)
        budget.observe(UplinkReport(step * STEP_NS, round(sent_bytes), receptions=told))
        estimates.append(budget.capacity_kbps(step * STEP_NS))
        sent_bytes += estimates[-1] * 0.92 * bias * STEP_NS / 8e6
    return estimates


def test_it_stays_where_it_starts_until_the_first_report():
    assert set(run(lambda _t, _kbps: None, 30)) == {3000}


@settings(deadline=None)
@given(st.floats(0.97, 1.03))
def test_no_bias_of_the_encoders_makes_it_drift(bias):
    held = run(lambda _t, _kbps: Reception("eih", 0.05, TRIP_NS, 0), 180, bias)
    assert set(held) == {3000}
    assert run(clean, 60, bias) == run(clean, 60)


@settings(deadline=None)
@given(st.floats(0.97, 1.03))
def test_with_a_link_that_fills_up_it_swings_around_the_same_rate_under_any_bias(bias):
    def link(_t_s: float, kbps: float) -> Reception:
        return Reception("eih", 0.2 if kbps > 4000 else 0.0, TRIP_NS, 0)

    late = run(link, 300, bias)[-1500:]
    limit_kbps = 4000 / 0.92 / bias
    assert 0.85 * limit_kbps - 200 < min(late) < max(late) < limit_kbps + 200


def test_it_grows_by_a_hundred_kilobits_a_second_while_the_allowance_is_used():
    estimates = run(clean, 20)
    assert estimates[-1] == pytest.approx(3000 + 1900, abs=110)
    assert run(clean, 20, bias=0.5)[-1] == 3000


def test_loss_above_a_tenth_cuts_it_once_a_window():
    assert run(lambda _t, _kbps: Reception("eih", 0.11, None, 0), 3.1)[-1] == pytest.approx(
        3000 * 0.85**3
    )


def test_a_longer_round_trip_cuts_it():
    def queue(t_s: float, _kbps: float) -> Reception:
        longer_ns = 60 * NS_PER_MS if t_s > 5 else 0
        return Reception("eih", 0.0, TRIP_NS + longer_ns, 3 * NS_PER_MS)

    assert run(queue, 7)[-1] < 0.9 * max(run(queue, 7))


def test_reports_that_stop_cut_it_and_a_single_missing_one_does_not():
    def until(t_s: float, _kbps: float) -> Reception | None:
        return Reception("eih", 0.05, TRIP_NS, 0) if t_s < 5 else None

    assert run(until, 9)[-1] == 3000
    assert run(until, 60)[-1] < 100
