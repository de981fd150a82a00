"""The strategies, and the policy that asks one of them for targets."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction

from tams_app.capacity import Capacity
from tams_app.config import Config, PolicyConfig
from tams_app.policy.budget import BUDGETS, Budget
from tams_app.policy.strategy import Strategy
from tams_app.records import Allocation, Phase, UplinkReport
from tams_app.registry import Registry

LEAST_SHARE = Fraction(1, 6)  # of the floor, below the sum of floors: 5 of 30 frames a second


class Equal(Strategy):
    """The same share for every view."""

    def weights(self, phase: Phase) -> Mapping[str, float]:
        views = self.policy.weights.matrix[Phase.REACH]
        return dict.fromkeys(views, 1 / len(views))


class Static(Strategy):
    """Fixed shares for the whole task."""

    def weights(self, phase: Phase) -> Mapping[str, float]:
        return self.policy.allocation.static_weights


class TaskAware(Strategy):
    """TAMS: the row of W of the current phase."""

    def weights(self, phase: Phase) -> Mapping[str, float]:
        return dict(self.policy.weights.matrix[phase])


class TamsPlus(TaskAware):
    """`tams+`: below the sum of floors views of low weight have fewer frames, not worse ones."""

    def __init__(self, policy: PolicyConfig) -> None:
        super().__init__(policy)
        self.source_drop_below_kbps = self.floor_kbps

    def targets(self, phase: Phase, budget_kbps: float) -> dict[str, int]:
        weights = self.weights(phase)
        if budget_kbps < len(weights) * self.floor_kbps:
            return ladder(weights, budget_kbps, self.floor_kbps)
        return super().targets(phase, budget_kbps)


def ladder(weights: Mapping[str, float], budget_kbps: float, floor_kbps: float) -> dict[str, int]:
    """Targets below the sum of floors: a few frames for each view, then by weight up to the floor.

    Args:
        weights: one non-negative share per view.
        budget_kbps: what all views may use together [kbit/s]; a negative one counts as 0.
        floor_kbps: what no target exceeds [kbit/s].

    Returns:
        The target of each view in whole kbit/s, rounded down: the sum never exceeds the budget, and
        no target decreases when the budget grows.
    """
    budget = Fraction(max(0.0, budget_kbps))
    floor = Fraction(floor_kbps)
    least = min(LEAST_SHARE * floor, budget / len(weights))
    spare = budget - len(weights) * least
    shares = {view: Fraction(str(weight)) for view, weight in weights.items()}
    total = sum(shares.values())
    targets = dict.fromkeys(weights, int(least))
    # the largest share meets the floor first; what it may not have, the others divide
    for view in sorted(shares, key=shares.__getitem__, reverse=True):
        if not shares[view]:
            break
        more = min(floor - least, spare * shares[view] / total)
        targets[view] = int(least + more)
        spare -= more
        total -= shares[view]
    return targets


STRATEGIES: Registry[type[Strategy]] = Registry(
    "strategy",
    "tams.strategies",
    {"equal": Equal, "static": Static, "tams": TaskAware, "tams+": TamsPlus},
)
"""The strategies by their word for `strategy`; entry points of `tams.strategies`."""


class Policy:
    """Capacity by the budget, targets by the strategy."""

    def __init__(self, strategy: Strategy, budget: Budget, config: PolicyConfig) -> None:
        self.strategy = strategy
        self.budget = budget
        self._safety_factor = config.budget.safety_factor

    @staticmethod
    def of(config: Config, capacity: Capacity) -> Policy:
        """The policy of a configuration; ConfigError if its strategy or budget does not exist.

        `capacity`: the emulated link's, for the budget `oracle`.
        """
        settings = config.policy
        strategy = STRATEGIES[config.strategy](settings)
        budget = BUDGETS[settings.budget.mode](settings, capacity)
        return Policy(strategy, budget, settings)

    def step(self, phase: Phase, report: UplinkReport) -> Allocation:
        """One allocation (paper, section III-D): targets, and what they follow from.

        `report`: what the senders know now; its time must not decrease from call to call.
        """
        now_ns = report.now_ns
        self.budget.observe(report)
        capacity_kbps = self.budget.capacity_kbps(now_ns)
        budget_kbps = capacity_kbps * self._safety_factor
        targets = self.strategy.targets(phase, budget_kbps)
        return Allocation(now_ns, phase, capacity_kbps, budget_kbps, targets)
