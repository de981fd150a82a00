"""A strategy that gives all that is not a floor to the last view."""

from collections.abc import Mapping

from tams_app.policy.strategy import Strategy
from tams_app.records import Phase


class Last(Strategy):
    def weights(self, phase: Phase) -> Mapping[str, float]:
        views = list(self.policy.weights.matrix[Phase.REACH])
        return dict.fromkeys(views, 0.0) | {views[-1]: 1.0}
