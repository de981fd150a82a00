"""The allocation rule (paper, section III-D) and the strategies that feed it their weights."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction
from functools import lru_cache
from typing import Protocol

from tams_app.capacity import Capacity
from tams_app.config import Config, PolicyConfig
from tams_app.errors import ConfigError
from tams_app.policy.budget import Budget, make_budget
from tams_app.records import Allocation, Phase, UplinkReport


def allocate(weights: Mapping[str, float], budget_kbps: float, floor_kbps: float) -> dict[str, int]:
    """Target bitrates by the allocation rule (paper, section III-D, equations 4 and 5).

    b_v = b_min + w_v (B - V b_min) for B >= V b_min, else b_v = B / V. The arithmetic is exact on
    the decimal weights: 0.23 + 0.50 + 0.27 is 1, not almost 1.

    Args:
        weights: w_v, one non-negative share per view; divided by their sum, which must not be 0.
        budget_kbps: B_t, what all views may use together [kbit/s]; a negative one counts as 0.
        floor_kbps: b_min, the least that each view gets while the budget allows it [kbit/s].

    Returns:
        The target of each view in whole kbit/s, rounded down: the sum never exceeds the budget, and
        no target decreases when the budget grows.

    Raises:
        OverflowError: the budget is infinite.
    """
    return dict(_allocated(tuple(weights.items()), budget_kbps, floor_kbps))


@lru_cache(maxsize=8)  # asked 20 times a second, and most often the same
def _allocated(
    weights: tuple[tuple[str, float], ...], budget_kbps: float, floor_kbps: float
) -> dict[str, int]:
    budget = Fraction(max(0.0, budget_kbps))
    floor = Fraction(floor_kbps)
    views = len(weights)
    if budget < views * floor:
        return {view: int(budget / views) for view, _ in weights}
    shares = {view: Fraction(str(weight)) for view, weight in weights}
    total = sum(shares.values())
    spare = budget - views * floor
    return {view: int(floor + share / total * spare) for view, share in shares.items()}


class Strategy(Protocol):
    """The rule that gives each view its share of the bits above the floor.

    An own one is a class whose constructor takes the `PolicyConfig`, entered in `STRATEGIES` under
    the name that the configuration's `strategy` then accepts.
    """

    def weights(self, phase: Phase) -> Mapping[str, float]:
        """The shares in `phase`: W_{p,v} of the paper's section III-C.

        Args:
            phase: the phase that was inferred last.

        Returns:
            One non-negative share for each configured view; they sum to 1 (paper, equation 2).
        """


class Equal:
    """The same share for every view."""

    def __init__(self, policy: PolicyConfig) -> None:
        views = list(policy.weights.matrix[Phase.REACH])
        self._weights = dict.fromkeys(views, 1 / len(views))

    def weights(self, phase: Phase) -> Mapping[str, float]:
        return self._weights


class Static:
    """Fixed shares for the whole task."""

    def __init__(self, policy: PolicyConfig) -> None:
        self._weights = policy.allocation.static_weights

    def weights(self, phase: Phase) -> Mapping[str, float]:
        return self._weights


class TaskAware:
    """TAMS: the row of W of the current phase."""

    def __init__(self, policy: PolicyConfig) -> None:
        self._matrix = WeightMatrix(policy.weights.matrix)

    def weights(self, phase: Phase) -> Mapping[str, float]:
        return self._matrix.row(phase)


STRATEGIES: dict[str, Callable[[PolicyConfig], Strategy]] = {
    "equal": Equal,
    "static": Static,
    "tams": TaskAware,
}


def make_strategy(name: str, policy: PolicyConfig) -> Strategy:
    """Make the strategy of that name.

    Args:
        name: a key of `STRATEGIES`.
        policy: the policy's configuration, of which the strategy takes its weights.

    Returns:
        A new strategy.

    Raises:
        ConfigError: there is none of that name; the message lists the valid ones.
    """
    if name not in STRATEGIES:
        raise ConfigError(f"strategy: {name!r} is none of {', '.join(STRATEGIES)}")
    return STRATEGIES[name](policy)


class WeightMatrix:
    """W[p, v], phases by views; each row sums to 1 (equation 2), which the configuration checks."""

    def __init__(self, rows: Mapping[Phase, Mapping[str, float]]) -> None:
        self._rows = {phase: dict(row) for phase, row in rows.items()}
        self._primary = {phase: max(row, key=row.__getitem__) for phase, row in rows.items()}

    def row(self, phase: Phase) -> dict[str, float]:
        """The share of each view in `phase`."""
        return dict(self._rows[phase])

    def primary_view(self, phase: Phase) -> str:
        """The view with the largest share in `phase`; of equals, the first named."""
        return self._primary[phase]


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
        return Policy(strategy, make_budget(settings, capacity), settings)

    def step(self, phase: Phase, report: UplinkReport) -> Allocation:
        """One allocation (paper, section III-D).

        Args:
            phase: s_t, the current phase.
            report: what the senders know now; its time must not decrease from call to call.

        Returns:
            The target bitrate of each view [kbit/s of IP datagram bytes], and what it follows from:
            phase, estimated capacity and budget B_t (the capacity times the safety factor).
        """
        now_ns = report.now_ns
        self._budget.observe(report)
        capacity_kbps = self._budget.capacity_kbps(now_ns)
        budget_kbps = capacity_kbps * self._safety_factor
        targets = allocate(self._strategy.weights(phase), budget_kbps, self._floor_kbps)
        return Allocation(now_ns, phase, capacity_kbps, budget_kbps, targets)
