"""How a budget is shared among views: the paper's rule, and one with bounds for each view."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from fractions import Fraction
from functools import lru_cache


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
    targets = shared(dict(weights), budget_kbps, floor_kbps)
    return {view: int(target) for view, target in targets.items()}


def shared(
    weights: Mapping[str, float], budget_kbps: float, floor_kbps: float
) -> dict[str, Fraction]:
    """What `allocate` rounds down."""
    budget = Fraction(max(0.0, budget_kbps))
    floor = Fraction(floor_kbps)
    views = len(weights)
    if budget < views * floor:
        return dict.fromkeys(weights, budget / views)
    shares = {view: Fraction(str(weight)) for view, weight in weights.items()}
    total = sum(shares.values())
    spare = budget - views * floor
    return {view: floor + share / total * spare for view, share in shares.items()}


@dataclass(frozen=True, slots=True)
class Demand:
    """What one view may get: `base` and a `share` of the rest, within `least` and `most`.

    All in kbit/s but the share, of which only the ratio to the others' counts.
    `least` must not exceed `most`.
    """

    share: Fraction
    base: Fraction
    least: Fraction
    most: Fraction

    def at(self, level: Fraction) -> Fraction:
        """The target where the rest that is shared is `level` for a share of 1."""
        return min(self.most, max(self.least, self.base + level * self.share))

    def bends(self) -> list[Fraction]:
        """The levels at which `at` begins or ceases to grow."""
        if not self.share:
            return []
        return [max(Fraction(0), (end - self.base) / self.share) for end in (self.least, self.most)]


def pour(budget_kbps: float, demands: Mapping[str, Demand]) -> dict[str, int]:
    """Targets by water-filling: what one view may not have goes to the others by their shares.

    All views stand at the same level, the highest at which the sum of targets is at most the
    budget. The arithmetic is exact; bits that no view may have stay unused.

    Args:
        budget_kbps: what all views may use together [kbit/s], finite; a negative one counts as 0.
        demands: of each view. A budget below the sum of what they get at least, and of what they
            would get at level 0, is shared in proportion to that.

    Returns:
        The target of each view in whole kbit/s, rounded down: the sum never exceeds the budget, and
        no target decreases when the budget grows.
    """
    budget = Fraction(max(0.0, budget_kbps))
    views = demands.values()
    low = Fraction(0)
    low_sum = _sum(views, low)
    if budget < low_sum:
        return {v: int(budget * demand.at(low) / low_sum) for v, demand in demands.items()}
    for high in sorted(bend for demand in views for bend in demand.bends()):
        high_sum = _sum(views, high)
        if high_sum > budget:
            low += (budget - low_sum) / (high_sum - low_sum) * (high - low)
            break
        low, low_sum = high, high_sum
    return {view: int(demand.at(low)) for view, demand in demands.items()}


def _sum(demands: Iterable[Demand], level: Fraction) -> Fraction:
    return sum((demand.at(level) for demand in demands), Fraction(0))
