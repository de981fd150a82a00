"""A budget that always believes in 3000 kbit/s."""

from tams_app.policy.budget import BudgetKind
from tams_app.records import UplinkReport

CAPACITY_KBPS = 3000.0


class Constant:
    def observe(self, report: UplinkReport) -> None:
        """Look at nothing."""

    def capacity_kbps(self, now_ns: int) -> float:
        return CAPACITY_KBPS

    def padding_bytes(self, now_ns: int) -> int:
        return 0

    def flight_limit_bytes(self, now_ns: int) -> float:
        return float("inf")


KIND = BudgetKind(lambda _policy, _capacity: Constant(), receives_reports=False)
