"""The operator's judgement of the video: how far it lags, and whether it is frozen.

Operators do not know the latency of a stream. They know what their hand did and see when the
gripper does it: the delay at which the two agree best is the lag (delays of hand and cursor are
perceived and adapted to from about this: Cunningham, Billock and Tsou 2001; Rohde and Ernst 2013).
"""

from __future__ import annotations

from collections import deque

import cv2
import numpy as np

from hw.sim.operator.efference import EfferenceCopy
from hw.sim.operator.vision.pinhole import Matrix
from tams_app.records import Image, Vector
from tams_app.units import NS_PER_MS

_CANDIDATES_NS = [lag * 25 * NS_PER_MS for lag in range(33)]  # to 800 ms
_USUAL_NS = 200 * NS_PER_MS  # arm and video when nothing is wrong
_USUAL_SPREAD_NS = 150 * NS_PER_MS
_SPAN_NS = 250 * NS_PER_MS  # of the movements compared
_FORGETS = 0.98  # a glance; about four seconds
_PIXEL_SIGMA = 1.5
_MISJUDGED = 0.15  # of the motion

_SMALL_PX = (160, 120)
_CHANGE = 10  # grey levels; codec flicker of a still image stays below
_CHANGED_PX = 8  # of the small image
_FROZEN_AFTER_M = 0.012  # asked of the tool meanwhile
_TRUSTS_AGAIN_NS = 2_000 * NS_PER_MS  # perhaps nothing moves because the hand is at rest


class LagEstimator:
    """Hand to eye [ns]: arm, network and decoder together."""

    def __init__(self, usual_ns: int = _USUAL_NS) -> None:
        """`usual_ns`: what they expect before they have seen anything."""
        lags = np.array(_CANDIDATES_NS, float)
        self._prior = ((lags - usual_ns) / _USUAL_SPREAD_NS) ** 2
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
        """What shows the gripper's motion is at `pixel` now.

        `slope`, shape (2, 3) or (2, 6): pixels per metre, and per radian, that the gripper moves.
        `source` distinguishes where the pixel comes from; only like is compared with like.
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
        expected = (np.array(now) - np.array(then))[:, : slope.shape[1]] @ slope.T
        moved = pixel - then_pixel
        doubt = _PIXEL_SIGMA + _MISJUDGED * float(np.linalg.norm(expected, axis=1).max())
        costs = ((expected - moved) ** 2).sum(axis=1) / doubt**2
        self._costs = _FORGETS * self._costs + (costs - costs.min())


class FrozenViewWatch:
    """Detects whether one view is frozen: the hand moves, and nothing in the image does."""

    def __init__(self) -> None:
        self._last: Image | None = None
        self._path_m = 0.0
        self._since_ns = 0

    def is_frozen(self, now_ns: int, image: Image, asked_m: float) -> bool:
        """`asked_m`: how far the tool was asked to move since the last look, as it should show."""
        grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
        small = np.asarray(cv2.resize(grey, _SMALL_PX, interpolation=cv2.INTER_AREA), np.uint8)
        last, self._last = self._last, small
        if last is None or np.count_nonzero(cv2.absdiff(last, small) > _CHANGE) >= _CHANGED_PX:
            self._path_m, self._since_ns = 0.0, now_ns
            return False
        if asked_m > 0.0:
            self._path_m += asked_m
            if self._path_m < _FROZEN_AFTER_M:
                self._since_ns = now_ns
        elif now_ns - self._since_ns > _TRUSTS_AGAIN_NS:
            self._path_m, self._since_ns = 0.0, now_ns
        return self._path_m >= _FROZEN_AFTER_M
