"""A budget that always believes in 3000 kbit/s."""

from tams_app.policy.budget import Budget

CAPACITY_KBPS = 3000.0


class Constant(Budget):
    receives_reports = False

    def capacity_kbps(self, now_ns: int) -> float:
        return CAPACITY_KBPS
