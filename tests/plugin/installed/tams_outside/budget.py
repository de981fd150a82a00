"""A budget that always believes in 3000 kbit/s."""

from tams_app.policy.budget import Budget, BudgetKind

CAPACITY_KBPS = 3000.0


class Constant(Budget):
    def capacity_kbps(self, now_ns: int) -> float:
        return CAPACITY_KBPS


KIND = BudgetKind(lambda _policy, _capacity: Constant(), receives_reports=False)
