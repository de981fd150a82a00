"""Efference copy: the motion the hand has asked of the tool, against what the eyes have seen of it.

In motor control the brain's own record of its commands, in control theory the memory of a Smith
predictor (Miall et al. 1993).
"""

from __future__ import annotations

from bisect import bisect_right
from collections import deque
from collections.abc import Sequence
from operator import itemgetter

import numpy as np

from hw.sim.operator.servoing import norm
from tams_app.records import Pose, Vector
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
