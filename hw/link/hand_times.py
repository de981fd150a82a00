"""The times of an operator's hand on our clock, of which the hand's speed is computed.

The transit time of a message is when it was received minus when it was sent, each by its own clock
(RFC 3550, A.8): its one-way delay and the difference of the clocks, which is not known.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from tams_app.link.age import LeastOffset
from tams_app.link.messages import HandMessage
from tams_app.records import Pose
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_MS

_SHORTEST_WITHIN_NS = 300 * NS_PER_MS  # until a longer delay counts, poses look old
_LEAST_TOLERANCE_NS, _LARGEST_TOLERANCE_NS = 5 * NS_PER_MS, 50 * NS_PER_MS
_RESTART_NS = 51 * NS_PER_MS  # longer than any gap across which `HandMotion` computes a speed
_SLEW = 4  # it falls by 1/4 of the time passed


@dataclass(frozen=True, slots=True)
class Transit:
    """The decision about the transit time of one sample.

    used_ns: what is added to the operator's times to have them on our clock [ns].
    is_early: it took less by more than the tolerance: only its pose is dropped.
    restarts: less is used from now on, and the hand's motion begins anew.
    """

    used_ns: int
    is_early: bool = False
    restarts: bool = False


class TransitFilter:
    """The transit time in use: the shortest of the last 300 ms, so that queueing only ages poses.

    A fall by up to `LinkConfig.jitter_ms` (5 ms at least, 50 at most) is followed at a quarter of
    the time passed; until then the hand looks up to a third faster. Messages that fall by more are
    early. If one with the longer time arrives within 51 ms, they were exceptions, and the longer
    time stays in use. Otherwise (a queue drained, the route changed) the shorter one is used at
    once and the motion restarts: the time that was skipped would look like a faster hand.
    """

    def __init__(self, jitter_ms: float) -> None:
        tolerance_ns = min(jitter_ms * NS_PER_MS, _LARGEST_TOLERANCE_NS)
        self._tolerance_ns = max(_LEAST_TOLERANCE_NS, tolerance_ns)
        self._shortest = LeastOffset(_SHORTEST_WITHIN_NS)
        self._used_ns: int | None = None
        self._sent_ns = 0  # of the newest message that was not early
        self._early_since_ns: int | None = None  # since then all were

    def step(self, sent_ns: int, received_ns: int) -> Transit:
        """Take in a message that counts: when it was sent and received, each by its own clock."""
        transit_ns, before_ns = received_ns - sent_ns, self._used_ns
        if before_ns is not None and self._is_early(before_ns - transit_ns, received_ns):
            if self._early_since_ns is None:
                self._early_since_ns = received_ns
            return Transit(transit_ns, is_early=True)
        used_ns, restarts = self._shortest.step(received_ns, transit_ns), False
        if before_ns is not None:
            restarts = before_ns - used_ns > self._tolerance_ns
            if not restarts:
                used_ns = max(used_ns, before_ns - (sent_ns - self._sent_ns) // _SLEW)
        self._used_ns, self._sent_ns, self._early_since_ns = used_ns, sent_ns, None
        return Transit(used_ns, restarts=restarts)

    def _is_early(self, shorter_ns: int, received_ns: int) -> bool:
        if shorter_ns <= self._tolerance_ns:
            return False
        since_ns = self._early_since_ns
        return since_ns is None or received_ns - since_ns < _RESTART_NS


class HandTimes:
    """Pose and buttons with the times when they were new, on our clock; times never decrease.

    What has not changed keeps its time, so that a hand that is frozen grows old. After a restart,
    poses of 51 ms are dropped: `HandMotion` begins anew after such a gap. So are early poses, but
    for the first after none; a lost pose counts at once.
    """

    def __init__(self) -> None:
        self.pose: Pose | None = None
        self.pose_ns = self.buttons_ns = 0
        self._posed: HandMessage | None = None  # the newest that was not early
        self._newest: HandMessage | None = None
        self._pose_from_ns = 0  # older poses are dropped

    def step(self, message: HandMessage, transit: Transit) -> None:
        """Take in a message that counts."""
        self._step_pose(message, transit)
        buttons_ns = message.buttons_ns + transit.used_ns
        if self._newest is None:
            self.buttons_ns = buttons_ns
        elif message.buttons_ns != self._newest.buttons_ns:
            self.buttons_ns = max(buttons_ns, self.buttons_ns)
        self._newest = message
        if not transit.is_early:
            self._posed = message

    def _step_pose(self, message: HandMessage, transit: Transit) -> None:
        before, pose, pose_ns = self._posed, _pose_of(message), message.pose_ns + transit.used_ns
        if before is None or pose is None or self.pose is None:
            self._pose_from_ns = 0
            self.pose, self.pose_ns = pose, max(pose_ns, self.pose_ns)
            return
        if transit.restarts:
            self._pose_from_ns = self.pose_ns + _RESTART_NS
        if transit.is_early or pose_ns < self._pose_from_ns:
            return
        self._pose_from_ns = 0
        if message.pose != before.pose or message.pose_ns != before.pose_ns:
            self.pose = pose
        if message.pose_ns != before.pose_ns:
            self.pose_ns = max(pose_ns, self.pose_ns)


def _pose_of(message: HandMessage) -> Pose | None:
    if message.pose is None:
        return None
    return Pose(np.array(message.pose[:3]), Rotation(*message.pose[3:]))
