"""Which packets a link loses: one draw per packet, so that the n-th packet's fate is fixed."""

from __future__ import annotations

from random import Random
from typing import Protocol


class LossModel(Protocol):
    """Decides packet by packet."""

    def lost(self) -> bool:
        """The fate of the next packet."""


class IndependentLoss:
    """Every packet is lost with the same probability."""

    def __init__(self, probability: float, random: Random) -> None:
        self._probability = probability
        self._random = random

    def lost(self) -> bool:
        return self._random.random() < self._probability


class GilbertElliottLoss:
    """Bursts: a two-state Markov chain over packets that loses all in its bad state, else none.

    `probability` is the long-run share lost, `mean_burst` the mean number of packets lost in a
    row: P(bad→good) = 1/mean_burst, P(good→bad) = probability / (mean_burst·(1−probability)).
    The chain starts in its stationary distribution. ValueError if no such chain exists.
    """

    def __init__(self, probability: float, mean_burst: float, random: Random) -> None:
        self._random = random
        self._recover = 1.0 / mean_burst
        self._fail = good_to_bad(probability, mean_burst)
        if self._fail > 1:
            raise ValueError("so much loss cannot come in such short bursts")
        self._bad = random.random() < probability

    def lost(self) -> bool:
        fate = self._bad
        threshold = 1.0 - self._recover if self._bad else self._fail
        self._bad = self._random.random() < threshold
        return fate


def good_to_bad(probability: float, mean_burst: float) -> float:
    """P(good→bad) of the chain with this long-run loss and mean burst; > 1 if there is none."""
    if probability >= 1:
        return 1.0
    return probability / (mean_burst * (1.0 - probability))


def loss_model(probability: float, mean_burst: float, random: Random) -> LossModel:
    """Independent loss for a mean burst of 1, Gilbert-Elliott above."""
    if mean_burst == 1 or probability in (0, 1):
        return IndependentLoss(probability, random)
    return GilbertElliottLoss(probability, mean_burst, random)
