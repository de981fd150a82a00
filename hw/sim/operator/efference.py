"""Efference copy: the motion the hand has asked of the tool, against what the eyes have seen of it.

In motor control the brain's own record of its commands, in control theory the memory of a Smith
predictor (Miall et al. 1993). By it operators notice that the tool does not follow, how far a video
lags, and whether it is frozen. They do not know the latency of a stream. They know what their hand
did and see when the gripper does it: the delay at which the two agree best is the lag (delays of
hand and cursor are perceived and adapted to from about this: Cunningham, Billock and Tsou 2001;
Rohde and Ernst 2013).
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from operator import itemgetter

import cv2
import numpy as np

from hw.sim.operator.servoing import norm
from hw.sim.operator.vision.views import Matrix
from tams_app.records import Image, Pose, Vector
from tams_app.units import NS_PER_MS

FOLLOW_LAG_NS = 100 * NS_PER_MS  # how far operators believe the arm to be behind the hand

_REMEMBERED_NS = 3_000 * NS_PER_MS

_BEGUN_M = 0.003
_BEGUN_RAD = 0.02
_DUE_NS = 600 * NS_PER_MS  # motion that has been asked for so long must show
_DUE_M = 0.020
_DUE_RAD = 0.12
_FOLLOWED = 0.25  # least part of the due motion that must be visible


class EfferenceCopy:
    """The motion asked of the tool so far: translation [m], then rotation vector [rad].

    One thread adds, others may read.
    """

    def __init__(self) -> None:
        self.total: Vector = np.zeros(6)
        self._history: deque[tuple[int, Vector]] = deque([(0, self.total)])

    def add(self, now_ns: int, linear: Vector, angular: Vector) -> None:
        """Note a displacement asked for until `now_ns`, which never goes back."""
        self.total = self.total + np.concatenate((linear, angular))
        self.idle(now_ns)

    def idle(self, now_ns: int) -> None:
        """Note that nothing was asked for until `now_ns`."""
        self._history.append((now_ns, self.total))
        while self._history[0][0] < now_ns - _REMEMBERED_NS:
            self._history.popleft()

    def shown_at(self, view_ns: int) -> Vector:
        """The part of `total` that a view from `view_ns` can show."""
        return self.asked_at(view_ns - FOLLOW_LAG_NS)

    def asked_at(self, t_ns: int) -> Vector:
        """`total` as it was at `t_ns`, of the last seconds: earlier, the oldest remembered."""
        return self.asked_at_each([t_ns])[0]

    def asked_at_each(self, times_ns: Sequence[int]) -> list[Vector]:
        """The same for several times."""
        history = list(self._history)
        places = [bisect_right(history, t_ns, key=itemgetter(0)) - 1 for t_ns in times_ns]
        return [history[max(0, place)][1] for place in places]


class FollowCheck:
    """Detects whether the tool follows: motion that was asked for must show in time."""

    def __init__(self) -> None:
        self._mark: tuple[int, Vector, Pose] | None = None

    def reset(self) -> None:
        """Forget what was asked, because the hand starts anew."""
        self._mark = None

    def step(self, view_ns: int, shown: Vector, tool: Pose) -> bool | None:
        """True: it followed; False: it did not; None: too early to decide.

        `shown` is `EfferenceCopy.shown_at(view_ns)`, `tool` the tool as the view shows it.
        """
        if self._mark is None:
            self._mark = (view_ns, shown, tool)
            return None
        mark_ns, mark_shown, mark_tool = self._mark
        asked = shown - mark_shown
        moved, turned = norm(asked[:3]), norm(asked[3:])
        if moved < _BEGUN_M and turned < _BEGUN_RAD:
            self._mark = (view_ns, mark_shown, tool)
            return None
        if view_ns - mark_ns < _DUE_NS or (moved < _DUE_M and turned < _DUE_RAD):
            return None
        self._mark = None
        if moved >= _DUE_M and norm(tool.position - mark_tool.position) < _FOLLOWED * moved:
            return False
        seen_turn = (tool.rotation * mark_tool.rotation.inv()).magnitude()
        return turned < _DUE_RAD or seen_turn >= _FOLLOWED * turned


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
