"""A strategy that gives all that is not a floor to the last view."""

from collections.abc import Mapping

from tams_app.config import PolicyConfig
from tams_app.policy.strategy import Strategy
from tams_app.records import Phase


class Last(Strategy):
    def __init__(self, policy: PolicyConfig) -> None:
        super().__init__(policy)
        self._views = list(policy.weights.matrix[Phase.REACH])

    def weights(self, phase: Phase) -> Mapping[str, float]:
        return dict.fromkeys(self._views, 0.0) | {self._views[-1]: 1.0}
