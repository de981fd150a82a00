"""The allocation rule (paper, section III-D) and the strategies that feed it their weights."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from fractions import Fraction
from typing import Protocol

from tams_app.config import PolicyConfig
from tams_app.errors import ConfigError
from tams_app.policy.weights import WeightMatrix
from tams_app.records import Phase


def allocate(weights: Mapping[str, float], budget_kbps: float, floor_kbps: float) -> dict[str, int]:
    """Targets [kbit/s] per view: b_v = b_min + w_v (B - V b_min), or B/V below V floors.

    Rounded down to whole kbit/s, so the sum never exceeds `budget_kbps`; monotone in the budget.
    Exact arithmetic on the decimal weights: 0.23 + 0.50 + 0.27 is 1, not almost 1.
    """
    budget = Fraction(max(0.0, budget_kbps))
    floor = Fraction(floor_kbps)
    views = len(weights)
    if budget < views * floor:
        return {view: int(budget / views) for view in weights}
    shares = {view: Fraction(str(weight)) for view, weight in weights.items()}
    total = sum(shares.values())
    spare = budget - views * floor
    return {view: int(floor + share / total * spare) for view, share in shares.items()}


class Strategy(Protocol):
    """Which share of the spare bits each view gets in a phase."""

    def weights(self, phase: Phase) -> Mapping[str, float]:
        """One non-negative share per view; they sum to 1."""


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
    """The strategy called `name`; ConfigError lists the valid names."""
    if name not in STRATEGIES:
        raise ConfigError(f"strategy: {name!r} is none of {', '.join(STRATEGIES)}")
    return STRATEGIES[name](policy)
