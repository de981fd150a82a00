"""The policy as one part: phase in, target bitrates out."""

from __future__ import annotations

from tams_app.capacity import Capacity
from tams_app.config import Config, PolicyConfig
from tams_app.policy.allocation import Strategy, allocate, make_strategy
from tams_app.policy.budget import Budget, make_budget
from tams_app.records import Allocation, Phase


class Policy:
    """Weights by the strategy, capacity by the budget, targets by the allocation rule."""

    def __init__(self, strategy: Strategy, budget: Budget, config: PolicyConfig) -> None:
        self._strategy = strategy
        self._budget = budget
        self._safety_factor = config.budget.safety_factor
        self._floor_kbps = config.allocation.floor_kbps

    @staticmethod
    def of(config: Config, capacity: Capacity) -> Policy:
        """The policy that `config` names, for a link of this capacity; ConfigError if none."""
        settings = config.policy
        strategy = make_strategy(config.strategy, settings)
        return Policy(strategy, make_budget(settings.budget, capacity), settings)

    def step(self, now_ns: int, phase: Phase, sent_bytes: int) -> Allocation:
        """One allocation (paper, section III-D).

        Args:
            now_ns: the time [ns]; must not decrease from call to call.
            phase: s_t, the current phase.
            sent_bytes: IP datagram bytes of all views sent since the start, repair included.

        Returns:
            The target bitrate of each view [kbit/s of IP datagram bytes], and what it follows from:
            phase, estimated capacity and budget B_t (the capacity times the safety factor).
        """
        self._budget.observe(now_ns, sent_bytes)
        capacity_kbps = self._budget.capacity_kbps(now_ns)
        budget_kbps = capacity_kbps * self._safety_factor
        targets = allocate(self._strategy.weights(phase), budget_kbps, self._floor_kbps)
        return Allocation(now_ns, phase, capacity_kbps, budget_kbps, targets)
