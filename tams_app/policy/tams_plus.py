"""The strategy `tams+`: the paper's weights, and what phase, timers and encoders say besides."""

from __future__ import annotations

import math
from collections.abc import Mapping
from fractions import Fraction

from tams_app.config import PolicyConfig
from tams_app.policy.coding import CodingStatistics, ViewCoding
from tams_app.policy.phases import Foreseen
from tams_app.policy.sharing import Demand, allocate, pour, shared
from tams_app.policy.strategy import Situation, Weighted
from tams_app.policy.weights import WeightMatrix
from tams_app.records import Phase
from tams_app.units import NS_PER_MS

DWELL_NS = 100 * NS_PER_MS  # a phase lasts this long before bits move; Release lasts 8 ms
_HAVE_WAITED = (Phase.ALIGN, Phase.PRE_RELEASE)  # Algorithm 1 lets these two wait itself
FORESEEN_SHARE = 0.5  # of the way to the next phase's weights, at most, before it begins
FINEST_QP = 18.0  # finer is not seen: H.264 is commonly taken as visually lossless from here
LEAST_SHARE = Fraction(1, 6)  # of the floor, below the sum of floors: 5 of 30 frames a second


class TamsPlus(Weighted):
    """TAMS with five additions, each of which `policy.tams_plus` can switch off."""

    def __init__(self, policy: PolicyConfig) -> None:
        super().__init__(policy)
        self._parts = policy.tams_plus
        self._matrix = WeightMatrix(policy.weights.matrix)
        self._phase = SettledPhase(DWELL_NS if self._parts.hysteresis else 0)
        self._coding = CodingStatistics()
        if self._parts.ladder:
            # a view below the floor has fewer frames instead of worse ones
            self.source_drop_below_kbps = self.floor_kbps

    def weights(self, phase: Phase) -> Mapping[str, float]:
        return self._matrix.row(phase)

    def targets(self, situation: Situation) -> dict[str, int]:
        phase = self._phase.step(situation.now_ns, situation.phase)
        self._coding.observe(situation.now_ns, situation.coded)
        budget_kbps = situation.budget_kbps
        weights = self.weights(phase)
        if self._parts.lookahead and situation.foreseen is not None:
            weights = raised(weights, self.weights(situation.foreseen.phase), situation.foreseen)
        if budget_kbps < len(weights) * self.floor_kbps:
            if self._parts.ladder:
                return pour(budget_kbps, ladder(weights, self.floor_kbps))
        elif self._parts.redistribution or self._parts.slopes:
            primary = self._matrix.primary_view(phase)
            return pour(budget_kbps, self._demands(weights, primary, budget_kbps))
        return allocate(weights, budget_kbps, self.floor_kbps)

    def _demands(
        self, weights: Mapping[str, float], primary: str, budget_kbps: float
    ) -> dict[str, Demand]:
        """By share, with bounds: the primary view never pays for the others."""
        plain = shared(weights, budget_kbps, self.floor_kbps)
        coding = {view: self._coding.view(view) for view in weights}
        shares = slopes(weights, coding) if self._parts.slopes else None
        budget, floor = Fraction(budget_kbps), Fraction(self.floor_kbps)
        demands = {}
        for view, weight in weights.items():
            least = plain[view] if view == primary else floor
            known = coding[view] if self._parts.redistribution else None
            most = budget if known is None else max(least, Fraction(known.kbps_at(FINEST_QP)))
            if shares is None:
                demands[view] = Demand(Fraction(str(weight)), floor, least, most)
            else:
                demands[view] = Demand(Fraction(shares[view]), Fraction(0), least, most)
        return demands


class SettledPhase:
    """The last phase that lasted for `dwell_ns`; the first counts at once, as one that waited."""

    def __init__(self, dwell_ns: int) -> None:
        self._dwell_ns = dwell_ns
        self._settled: Phase | None = None
        self._newest: Phase | None = None
        self._since_ns = 0

    def step(self, now_ns: int, phase: Phase) -> Phase:
        """The phase to go by, while `phase` is the one inferred."""
        if phase is not self._newest:
            self._newest, self._since_ns = phase, now_ns
        lasted = now_ns - self._since_ns >= self._dwell_ns
        if self._settled is None or lasted or phase in _HAVE_WAITED:
            self._settled = phase
        return self._settled


def raised(
    weights: Mapping[str, float], following: Mapping[str, float], foreseen: Foreseen
) -> dict[str, float]:
    """`weights` on their way to those of the foreseen phase, as far as its timer has come."""
    way = FORESEEN_SHARE * foreseen.progress
    return {view: (1 - way) * weight + way * following[view] for view, weight in weights.items()}


def slopes(
    weights: Mapping[str, float], coding: Mapping[str, ViewCoding | None]
) -> dict[str, float] | None:
    """The shares that maximise Σ w_v q_v(b_v), with q_v = -(complexity_v / b_v)²; None if unknown.

    The error is as the encoder itself takes it: λ, what it gives up in squared error for a bit,
    goes by 2^(QP/3), so it is least where w_v λ(QP_v) is the same for all. A view's rate at a QP is
    measured again with each frame, and the targets settle there although the rate's true dependence
    on QP is another: b_v in proportion to complexity_v √w_v is a step towards it.
    """
    shares = {}
    for view, weight in weights.items():
        known = coding[view]
        if known is None:
            return None
        shares[view] = known.complexity * math.sqrt(weight)
    return shares


def ladder(weights: Mapping[str, float], floor_kbps: float) -> dict[str, Demand]:
    """Below the sum of floors: by weight up to the floor, and for each view a few frames."""
    floor = Fraction(floor_kbps)
    least = LEAST_SHARE * floor
    return {v: Demand(Fraction(str(weight)), least, least, floor) for v, weight in weights.items()}
