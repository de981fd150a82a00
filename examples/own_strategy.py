"""A strategy of your own: most of the bits for the view that matters, the rest shared equally.

A strategy is one class with one method. Once it is in `STRATEGIES`, `strategy: primary` in a
configuration selects it, for live sessions, studies and virtual trials alike.
"""

from collections.abc import Mapping

from tams_app.config import load_config
from tams_app.policy.allocation import STRATEGIES
from tams_app.policy.strategy import Strategy
from tams_app.records import Phase


class PrimaryFirst(Strategy):
    """80 % for the primary view of the phase, the largest entry of its row of W."""

    def weights(self, phase: Phase) -> Mapping[str, float]:
        row = self.policy.weights.matrix[phase]
        primary = max(row, key=row.__getitem__)
        others = [view for view in row if view != primary]
        return {primary: 0.8} | {view: 0.2 / len(others) for view in others}


STRATEGIES["primary"] = PrimaryFirst

policy = load_config().policy
budget_kbps = 6000 * 0.92  # network s2, less the safety margin
for name in ("tams", "primary"):
    strategy = STRATEGIES[name](policy)
    for phase in Phase:
        targets = strategy.targets(phase, budget_kbps)
        print(f"{name:<8} {phase.name:<12}", *(f"{v} {kbps:>5}" for v, kbps in targets.items()))
