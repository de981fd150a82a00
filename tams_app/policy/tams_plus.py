"""The strategy `tams+`: the paper's weights, and what phase, timers and encoders say besides."""

from __future__ import annotations

from collections.abc import Mapping
from fractions import Fraction

from tams_app.config import PolicyConfig
from tams_app.policy.coding import CodingStatistics
from tams_app.policy.phases import Foreseen
from tams_app.policy.sharing import Demand, allocate, pour, shared
from tams_app.policy.strategy import Situation, Weighted
from tams_app.policy.weights import WeightMatrix
from tams_app.records import Phase

FORESEEN_SHARE = 0.5  # of the way to the next phase's weights, at most, before it begins
FINEST_QP = 18.0  # finer is not seen: H.264 is commonly taken as visually lossless from here
LEAST_SHARE = Fraction(1, 6)  # of the floor, below the sum of floors: 5 of 30 frames a second


class TamsPlus(Weighted):
    """TAMS with three additions, each of which `policy.tams_plus` can switch off."""

    def __init__(self, policy: PolicyConfig) -> None:
        super().__init__(policy)
        self._parts = policy.tams_plus
        self._matrix = WeightMatrix(policy.weights.matrix)
        self._coding = CodingStatistics()
        self.reads_qp = self._parts.redistribution
        if self._parts.ladder:
            # a view below the floor has fewer frames instead of worse ones
            self.source_drop_below_kbps = self.floor_kbps

    def weights(self, phase: Phase) -> Mapping[str, float]:
        return self._matrix.row(phase)

    def targets(self, situation: Situation) -> dict[str, int]:
        self._coding.observe(situation.now_ns, situation.coded)
        budget_kbps = situation.budget_kbps
        weights = self.weights(situation.phase)
        if self._parts.lookahead and situation.foreseen is not None:
            weights = raised(weights, self.weights(situation.foreseen.phase), situation.foreseen)
        if budget_kbps < len(weights) * self.floor_kbps:
            if self._parts.ladder:
                return pour(budget_kbps, ladder(weights, self.floor_kbps))
        elif self._parts.redistribution:
            primary = self._matrix.primary_view(situation.phase)
            return pour(budget_kbps, self._demands(weights, primary, budget_kbps))
        return allocate(weights, budget_kbps, self.floor_kbps)

    def _demands(
        self, weights: Mapping[str, float], primary: str, budget_kbps: float
    ) -> dict[str, Demand]:
        """By weight, and no more than a view can use; the primary view pays nothing for that."""
        plain = shared(weights, budget_kbps, self.floor_kbps)
        floor = Fraction(self.floor_kbps)
        demands = {}
        for view, weight in weights.items():
            least = plain[view] if view == primary else floor
            coding = self._coding.view(view)
            useful = budget_kbps if coding is None else coding.kbps_at(FINEST_QP)
            most = max(least, Fraction(useful))
            demands[view] = Demand(Fraction(str(weight)), floor, least, most)
        return demands


def raised(
    weights: Mapping[str, float], following: Mapping[str, float], foreseen: Foreseen
) -> dict[str, float]:
    """`weights` on their way to those of the foreseen phase, as far as its timer has come."""
    way = FORESEEN_SHARE * foreseen.progress
    return {view: (1 - way) * weight + way * following[view] for view, weight in weights.items()}


def ladder(weights: Mapping[str, float], floor_kbps: float) -> dict[str, Demand]:
    """Below the sum of floors: by weight up to the floor, and for each view a few frames."""
    floor = Fraction(floor_kbps)
    least = LEAST_SHARE * floor
    return {v: Demand(Fraction(str(weight)), least, least, floor) for v, weight in weights.items()}
