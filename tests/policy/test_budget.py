"""Where the capacity comes from."""

import math

import pytest

from tams_app.capacity import UnlimitedCapacity
from tams_app.config import BudgetConfig, load_config
from tams_app.policy.allocation import Policy, make_strategy
from tams_app.policy.budget import BUDGETS, OracleBudget, SenderBudget, make_budget
from tams_app.records import Phase, UplinkReport

pytestmark = pytest.mark.untimed

MS = 1_000_000


class Falling:
    """A link that carries 1000 kbit/s until 5 s and 500 from then on."""

    def mean_kbps(self, start_ns, end_ns):
        def megabits_by(t_ns):
            return min(t_ns, 5000 * MS) * 1000 + max(0, t_ns - 5000 * MS) * 500

        return (megabits_by(end_ns) - megabits_by(start_ns)) / (end_ns - start_ns)


def test_the_oracle_sees_the_last_window_and_nothing_ahead():
    budget = OracleBudget(Falling(), BudgetConfig())
    assert budget.capacity_kbps(5000 * MS) == 1000
    assert budget.capacity_kbps(5050 * MS) == 750
    assert budget.capacity_kbps(5100 * MS) == 500


def test_without_a_bottleneck_the_oracle_gives_the_configured_maximum():
    budget = OracleBudget(UnlimitedCapacity(), BudgetConfig(max_kbps=20_000))
    assert budget.capacity_kbps(0) == 20_000


@pytest.mark.parametrize(
    "budget", [OracleBudget(Falling(), BudgetConfig()), SenderBudget(BudgetConfig())]
)
def test_without_feedback_on_packets_no_padding_is_asked_for_and_nothing_bound(budget):
    assert budget.padding_bytes(0) == 0
    assert budget.flight_limit_bytes(0) == math.inf


def test_every_mode_of_the_configuration_makes_its_budget():
    assert list(BUDGETS) == ["oracle", "sender", "feedback"]
    for mode in BUDGETS:
        policy = load_config(None, {"policy.budget.mode": mode}).policy
        assert mode in type(make_budget(policy, UnlimitedCapacity())).__name__.lower()


def test_the_policy_applies_the_safety_factor_before_it_allocates():
    config = load_config().policy
    policy = Policy(make_strategy("tams", config), OracleBudget(Falling(), config.budget), config)
    allocation = policy.step(Phase.ALIGN, UplinkReport(4000 * MS, 0))
    assert allocation.budget_kbps == pytest.approx(920)
    assert allocation.target_kbps == {"eih": 432, "gt": 244, "gs": 244}
