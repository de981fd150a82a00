"""How far the image lags the hand, judged by a person from his own movement and what he sees.

Nobody tells him the latency of a stream. He knows what his hand did and sees when the gripper does
it: the delay at which the two agree best is the lag (delays of hand and cursor are perceived and
adapted to from about this: Cunningham, Billock and Tsou 2001; Rohde and Ernst 2013).
"""

from __future__ import annotations

from collections import deque

import numpy as np

from hw.sim.operator.efference import EfferenceCopy
from hw.sim.operator.vision.pinhole import Matrix
from tams_app.records import Vector
from tams_app.runtime.clock import NS_PER_MS

_CANDIDATES_NS = [lag * 25 * NS_PER_MS for lag in range(33)]  # to 800 ms
_USUAL_NS = 200 * NS_PER_MS  # arm and video when nothing is wrong
_USUAL_SPREAD_NS = 150 * NS_PER_MS
_SPAN_NS = 250 * NS_PER_MS  # of the movements compared
_FORGETS = 0.98  # a glance; about four seconds
_PIXEL_SIGMA = 1.5
_MISJUDGED = 0.15  # of the motion


class LagEstimator:
    """Hand to eye [ns]: arm, network and decoder together."""

    def __init__(self) -> None:
        lags = np.array(_CANDIDATES_NS, float)
        self._prior = ((lags - _USUAL_NS) / _USUAL_SPREAD_NS) ** 2
        self._costs: Vector = np.zeros(len(lags))
        self._seen: dict[str, deque[tuple[int, Vector]]] = {}

    @property
    def lag_ns(self) -> int:
        """The lag that explains best what was seen."""
        costs = self._prior + self._costs
        best = int(np.argmin(costs))
        if not 0 < best < len(costs) - 1:
            return _CANDIDATES_NS[best]
        before, here, after = costs[best - 1 : best + 2]
        bend = before + after - 2.0 * here
        part = 0.5 * (before - after) / bend if bend > 0.0 else 0.0
        step_ns = _CANDIDATES_NS[1] - _CANDIDATES_NS[0]
        return round(_CANDIDATES_NS[best] + part * step_ns)

    def see(
        self, source: str, t_ns: int, pixel: Vector, slope: Matrix, asked: EfferenceCopy
    ) -> None:
        """The gripper is at `pixel` now; `slope`, shape (2, 3): pixels per metre it moves.

        `source` tells apart where the pixel comes from; only like is compared with like.
        """
        seen = self._seen.setdefault(source, deque())
        seen.append((t_ns, pixel))
        while len(seen) > 1 and seen[1][0] <= t_ns - _SPAN_NS:
            seen.popleft()
        then_ns, then_pixel = seen[0]
        if not _SPAN_NS <= t_ns - then_ns < 3 * _SPAN_NS:
            return
        now = asked.asked_at_each([t_ns - lag for lag in _CANDIDATES_NS])
        then = asked.asked_at_each([then_ns - lag for lag in _CANDIDATES_NS])
        expected = (np.array(now) - np.array(then))[:, :3] @ slope.T
        moved = pixel - then_pixel
        doubt = _PIXEL_SIGMA + _MISJUDGED * float(np.linalg.norm(expected, axis=1).max())
        costs = ((expected - moved) ** 2).sum(axis=1) / doubt**2
        self._costs = _FORGETS * self._costs + (costs - costs.min())
