"""The strategy `tams+`: TAMS, and another rule where the budget is below the sum of floors."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction

from tams_app.config import PolicyConfig
from tams_app.policy.strategy import Weighted
from tams_app.policy.weights import WeightMatrix
from tams_app.records import Phase

LEAST_SHARE = Fraction(1, 6)  # of the floor, below the sum of floors: 5 of 30 frames a second


class TamsPlus(Weighted):
    """TAMS; below the sum of floors views of low weight have fewer frames, not worse ones."""

    def __init__(self, policy: PolicyConfig) -> None:
        super().__init__(policy)
        self._matrix = WeightMatrix(policy.weights.matrix)
        self.source_drop_below_kbps = self.floor_kbps

    def weights(self, phase: Phase) -> Mapping[str, float]:
        return self._matrix.row(phase)

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
