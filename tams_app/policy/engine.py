"""The policy as one part: phase in, bitrate targets out."""

from __future__ import annotations

from tams_app.config import PolicyConfig
from tams_app.policy.allocation import Strategy, allocate
from tams_app.policy.budget import Budget
from tams_app.records import Allocation, Phase


class Policy:
    """Weights by the strategy, capacity by the budget, targets by the allocation rule."""

    def __init__(self, strategy: Strategy, budget: Budget, config: PolicyConfig) -> None:
        self._strategy = strategy
        self._budget = budget
        self._safety_factor = config.budget.safety_factor
        self._floor_kbps = config.allocation.floor_kbps

    def step(self, now_ns: int, phase: Phase) -> Allocation:
        """The targets for `phase` with the capacity known at `now_ns`."""
        capacity_kbps = self._budget.capacity_kbps(now_ns)
        budget_kbps = capacity_kbps * self._safety_factor
        targets = allocate(self._strategy.weights(phase), budget_kbps, self._floor_kbps)
        return Allocation(now_ns, phase, capacity_kbps, budget_kbps, targets)
