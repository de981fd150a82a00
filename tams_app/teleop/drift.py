"""How far the arm was asked to go that the hand did not, or was not that the hand did."""

from __future__ import annotations

import math

from tams_app.vectors import ZERO, Floats3, minus, norm, plus_times, times

_FORGETS_S = 1.0


class Drift:
    """The hand's velocities as they were used, integrated, less the motion that it really made.

    A pose that comes late or not at all makes the two differ: a velocity is used for longer or
    shorter than the hand had it, and what a long gap has hidden is left out. Who chooses which
    poses come late can lead the arm away by a little with each. Differences add up by direction,
    so that those of a poor network cancel out; they are forgotten with a time constant of 1 s.
    Neither side counts for more than the arm would do at its fastest.
    """

    def __init__(self, fastest: float, limit: float) -> None:
        """Both in units of the hand: m/s and m, or rad/s and rad."""
        self._fastest = fastest
        self._limit = limit
        self._ahead = ZERO

    def clear(self) -> None:
        """Begin anew."""
        self._ahead = ZERO

    def used(self, velocity: Floats3, interval_s: float) -> None:
        """This velocity was in force for `interval_s`."""
        kept = times(self._ahead, math.exp(-interval_s / _FORGETS_S))
        self._ahead = plus_times(kept, self._at_most(velocity), interval_s)

    def moved(self, change: Floats3, interval_s: float) -> None:
        """The hand moved by this from a pose to the next, made `interval_s` later."""
        if interval_s > 0.0:
            velocity = self._at_most(times(change, 1.0 / interval_s))
            self._ahead = minus(self._ahead, times(velocity, interval_s))

    @property
    def size(self) -> float:
        """How far the two are apart."""
        return norm(self._ahead)

    @property
    def is_too_large(self) -> bool:
        """Whether they are apart by more than the limit."""
        return self.size > self._limit

    def _at_most(self, velocity: Floats3) -> Floats3:
        speed = norm(velocity)
        return velocity if speed <= self._fastest else times(velocity, self._fastest / speed)
