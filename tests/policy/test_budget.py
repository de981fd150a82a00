"""Where the capacity comes from."""

import pytest

from tams_app.capacity import UnlimitedCapacity
from tams_app.config import BudgetConfig, load_config
from tams_app.policy.allocation import Policy, make_strategy
from tams_app.policy.budget import OracleBudget, SenderBudget
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


def test_the_sender_budget_starts_as_configured_and_then_follows_what_was_sent():
    budget = SenderBudget(BudgetConfig(start_kbps=3000, window_ms=1000, safety_factor=0.92))
    for tick in range(5):
        budget.observe(UplinkReport(tick * 200 * MS, tick * 25_000))  # 1000 kbit/s
        assert budget.capacity_kbps(tick * 200 * MS) == 3000
    for tick in range(5, 20):
        budget.observe(UplinkReport(tick * 200 * MS, tick * 25_000))
    assert budget.capacity_kbps(0) == pytest.approx(1000 / 0.92, rel=1e-9)


def test_the_sender_budget_neither_ratchets_down_nor_sees_free_capacity():
    budget = SenderBudget(BudgetConfig(start_kbps=3000))
    total, allowed = 0, 3000 * 0.92
    for tick in range(500):
        budget.observe(UplinkReport(tick * 100 * MS, total))
        allowed = budget.capacity_kbps(0) * 0.92
        total += round(allowed * 1000 / 8 / 10)
    assert allowed == pytest.approx(3000 * 0.92, rel=0.01)


def test_the_policy_applies_the_safety_factor_before_it_allocates():
    config = load_config().policy
    policy = Policy(make_strategy("tams", config), OracleBudget(Falling(), config.budget), config)
    allocation = policy.step(Phase.ALIGN, UplinkReport(4000 * MS, 0))
    assert allocation.budget_kbps == pytest.approx(920)
    assert allocation.target_kbps == {"eih": 432, "gt": 244, "gs": 244}
