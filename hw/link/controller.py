"""A controller whose samples come over the link; missing ones are a status, as with any other."""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from hw.controller import Controller
from tams_app.config import LinkConfig
from tams_app.link.age import LeastOffset, PeerClock
from tams_app.link.gaps import Breaks
from tams_app.link.messages import HandMessage
from tams_app.records import ControllerSample, ControllerStatus, Haptic, Pose, Presses
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_MS

_STATUSES = {status.value: status for status in ControllerStatus}
_LOST = ControllerSample.released(ControllerStatus.LINK_LOST)
_NOT_STARTED = replace(_LOST, status=ControllerStatus.DISCONNECTED)
_GAP = replace(_LOST, status=ControllerStatus.LINK_GAP)
_AWAY = replace(_LOST, status=ControllerStatus.OPERATOR_AWAY)
_UNIT_TOLERANCE = 1e-3  # of a rotation's quaternion
_WAY_WINDOW_NS = 300 * NS_PER_MS  # a way that has become longer stops the hand for so long
_SHORTER_WAY_NS, _LARGEST_SHORTER_WAY_NS = 5 * NS_PER_MS, 50 * NS_PER_MS
_JITTER_SAMPLES, _LARGEST_JITTER_NS = 120, 25 * NS_PER_MS  # a second's
_ANEW_NS = 51 * NS_PER_MS  # beyond the gap of which `HandMotion` makes nothing up


class LinkController(Controller):
    """The newest sample that may move the arm; `take` and `sample` are for the control thread.

    A sample counts if it cannot be older than `LinkConfig.longest_age_ms` (`PeerClock.age_ns`) and
    echoes a stamp of ours that is at most `longest_silence_ms` old. This drops samples queued
    during an outage, and those of an operator who receives nothing; dropped ones are counted.
    Their times are converted to our clock by the shortest one-way delay of the last 300 ms, so
    that poses of a steady hand keep a steady rate and queueing makes them older. Times never
    decrease, and unchanged values keep theirs. When the delay falls by more than 5 ms or
    `LinkConfig.jitter_ms`, at most 50 (a queue drained, the route changed), poses are ignored for
    50 ms, and the hand's motion restarts (`HandMotion`); otherwise motion of a longer time would
    pass for a faster hand. If a sample with the longer delay arrives within 51 ms, the faster ones
    were exceptions: their buttons and status count, their poses do not, and the longer delay stays
    in use. A smaller decrease is applied gradually; until then times are too new by the rest.

    A break is a time in which the newest sample that counts is older than `LinkConfig.bridge_ms`
    because others were lost, refused or late. Under jitter the median excess over the shortest
    delay is added, at most 25 ms: the hand slows down then, but no sample is missing. After three
    breaks within a second, samples have the status of too many gaps until that second is over, as
    an attacker who chooses what is lost could otherwise steer the arm.

    Without a pose that counts for `lost_after_ms` the link has a gap, after `fault_after_ms` it is
    lost. It is lost at once when another operator connects or the current one leaves.
    """

    def __init__(
        self,
        config: LinkConfig,
        receive: Callable[[int], None],
        pulse: Callable[[Haptic], None],
    ) -> None:
        """`receive` is called at the start of each `sample`, to `take` new messages."""
        self.refused: Counter[str] = Counter()  # samples that did not count, by reason
        self.clock = PeerClock()  # of the connected operator
        self._longest_age_ms = config.longest_age_ms
        self._longest_silence_ns = config.longest_silence_ms * NS_PER_MS
        self._lost_after_ns = config.lost_after_ms * NS_PER_MS
        self._fault_after_ns = config.fault_after_ms * NS_PER_MS
        self._receive = receive
        self._pulse = pulse
        self._bridge_ns = config.bridge_ms * NS_PER_MS
        self._breaks = Breaks()
        self.too_often = 0  # how many breaks made too many
        self._in_break = False
        self._ways_ns: deque[int] = deque(maxlen=_JITTER_SAMPLES)  # by the clocks as they are
        self.counted_ns: int | None = None  # when the newest whose pose counts was received
        self._gap_until_ns = 0  # then the link is lost
        self._newest: HandMessage | None = None  # that counted
        self._newest_ns = 0  # when it was sent, on our clock
        self._posed: HandMessage | None = None  # the newest that did not come too early
        self._early_from_ns: int | None = None  # since then each that counted came too early
        self._offset = LeastOffset(_WAY_WINDOW_NS)
        self._offset_ns = 0  # of `_posed`
        jitter_ns = min(config.jitter_ms * NS_PER_MS, _LARGEST_SHORTER_WAY_NS)
        self._shorter_way_ns = max(_SHORTER_WAY_NS, jitter_ns)
        self._anew_ns = 0  # poses wait until then, 0: they do not
        self._sample = _LOST
        self._absent = _LOST  # while nothing is received
        self._let_go = False
        self._started = False

    def start(self) -> None:
        self._started = True

    def sample(self, now_ns: int) -> ControllerSample:
        self._receive(now_ns)
        if not self._started:
            self._forget()
            return _NOT_STARTED
        heard_ns, let_go = self.counted_ns, self._let_go
        self._let_go = False
        if let_go:  # the next operator may have been heard since, but first the arm stops
            return self._absent
        if heard_ns is not None and now_ns - heard_ns > self._lost_after_ns:
            self._gap_until_ns = heard_ns + round(self._fault_after_ns)
            heard_ns = None
            self._forget()
        if heard_ns is None:
            return _GAP if now_ns < self._gap_until_ns else self._absent
        is_ok = self._sample.status is ControllerStatus.OK  # others stop the arm themselves
        if is_ok and self._breaks.too_many(now_ns):
            return replace(self._sample, status=ControllerStatus.LINK_GAPS)
        return self._sample

    def pulse(self, haptic: Haptic) -> None:
        if self._started:
            self._pulse(haptic)

    def close(self) -> None:
        self._started = False

    def take(self, message: HandMessage, heard_ns: int) -> str:
        """Take a sample that was heard at `heard_ns`; "" if it counts, else why it does not."""
        self.clock.step(message.echo_ns, message.echo_heard_ns, message.sent_ns, heard_ns)
        refusal = self._refusal(message, heard_ns)
        if refusal:
            self.refused[refusal] += 1
            return refusal
        is_early = self._is_early(message, heard_ns)
        self._count_break(heard_ns)
        if is_early:
            offset_ns = heard_ns - message.sent_ns
        else:
            offset_ns = self._offset_of(message, heard_ns)
            self._ways_ns.append(heard_ns - message.sent_ns)
        pose, pose_ns = self._pose(message, offset_ns, is_early)
        self._sample = ControllerSample(
            _STATUSES[message.status],
            pose,
            pose_ns,
            self._buttons_ns(message, offset_ns),
            trigger=message.trigger,
            grip=message.grip,
            a=message.a,
            b=message.b,
            menu=message.menu,
            presses=Presses(*message.presses),
        )
        self._newest, self._newest_ns = message, message.sent_ns + offset_ns
        if not is_early:
            self._posed, self._offset_ns, self._early_from_ns = message, offset_ns, None
            self.counted_ns = heard_ns
        elif self._early_from_ns is None:
            self._early_from_ns = heard_ns
        return ""

    def _is_early(self, message: HandMessage, heard_ns: int) -> bool:
        """Whether it came by a shorter way, and not all that have counted for 51 ms did."""
        shorter_ns = self._offset_ns - (heard_ns - message.sent_ns)
        if self._posed is None or shorter_ns <= self._shorter_way_ns:
            return False
        return self._early_from_ns is None or heard_ns - self._early_from_ns < _ANEW_NS

    def _buttons_ns(self, message: HandMessage, offset_ns: int) -> int:
        """When the buttons were read, on our clock: as it was while they were not read again."""
        before, last_ns = self._newest, self._sample.buttons_ns
        if before is None:
            return message.buttons_ns + offset_ns
        if message.buttons_ns == before.buttons_ns:
            return last_ns
        return max(message.buttons_ns + offset_ns, last_ns)

    def _count_break(self, heard_ns: int) -> None:
        """See how old the newest sample has become until this one was heard."""
        was_in_break, self._in_break = self._in_break, False
        if self._newest is not None:
            beyond_ns = heard_ns - self._newest_ns - self._bridge_ns
            self._in_break = beyond_ns > 0 and beyond_ns > self._jitter_ns()
        if self._in_break and not was_in_break:
            self.too_often += self._breaks.add(heard_ns)

    def _jitter_ns(self) -> int:
        """What half of the samples have taken beyond the shortest way, at most 25 ms."""
        median_ns = sorted(self._ways_ns)[len(self._ways_ns) // 2]
        return min(max(0, median_ns - self._offset_ns), _LARGEST_JITTER_NS)

    def _offset_of(self, message: HandMessage, heard_ns: int) -> int:
        """What makes the operator's times ours; what has become little less is less by and by."""
        least_ns = self._offset.step(heard_ns, heard_ns - message.sent_ns)
        if self._posed is None or self._offset_ns - least_ns > self._shorter_way_ns:
            return least_ns
        return max(least_ns, self._offset_ns - (message.sent_ns - self._posed.sent_ns) // 4)

    def _pose(
        self, message: HandMessage, offset_ns: int, is_early: bool
    ) -> tuple[Pose | None, int]:
        """The pose and its time on our clock: the last one's while it has not changed or waits."""
        before, last = self._posed, self._sample
        pose, pose_ns = _pose(message), message.pose_ns + offset_ns
        if before is None or pose is None or last.pose is None:
            self._anew_ns = 0
            return pose, max(pose_ns, 0 if before is None else last.pose_ns)
        if self._offset_ns - offset_ns > self._shorter_way_ns and not is_early:
            self._anew_ns = last.pose_ns + _ANEW_NS
        if is_early or pose_ns < self._anew_ns:
            return last.pose, last.pose_ns
        self._anew_ns = 0
        if message.pose_ns == before.pose_ns:
            return (last.pose if message.pose == before.pose else pose), last.pose_ns
        return pose, max(pose_ns, last.pose_ns)

    def let_go(self, left: bool = False) -> None:
        """Forget the operator: the link is lost once, what comes then is judged as the first.

        Args:
            left: they have said so.
        """
        self._let_go, self._absent = True, _AWAY if left else _LOST
        self.clock.forget()
        self._gap_until_ns = 0
        self._forget()

    def wake(self, now_ns: int) -> None:
        """This computer was suspended: the link is lost, and what is from before is too old."""
        self.let_go()
        self.clock.wake(now_ns)

    def _forget(self) -> None:
        self.counted_ns = self._newest = self._posed = self._early_from_ns = None
        self._anew_ns = 0
        self._in_break = False
        self._breaks = Breaks()
        self._ways_ns.clear()
        self._offset = LeastOffset(_WAY_WINDOW_NS)

    def _refusal(self, message: HandMessage, heard_ns: int) -> str:
        age_ns = self.clock.age_ns(message.sent_ns, message.echo_ns, heard_ns)
        if age_ns is None:
            return "without an echo"
        round_trip_ns = self.clock.round_trip_ns
        round_trip_ms = None if round_trip_ns is None else round_trip_ns / NS_PER_MS
        if age_ns > self._longest_age_ms(round_trip_ms) * NS_PER_MS:
            return "too old"
        if heard_ns - message.echo_ns > self._longest_silence_ns:
            return "unanswered"
        if self._newest is not None and message.sent_ns <= self._newest.sent_ns:
            return "overtaken"
        if max(message.pose_ns, message.buttons_ns) > message.sent_ns:
            return "from the future"
        if message.status not in _STATUSES:
            return "of unknown status"
        if message.pose is not None and not _is_rotation(message.pose[3:]):
            return "without a rotation"
        return ""


def _is_rotation(quaternion: tuple[float, ...]) -> bool:
    return abs(math.hypot(*quaternion) - 1.0) <= _UNIT_TOLERANCE  # never true of NaN


def _pose(message: HandMessage) -> Pose | None:
    if message.pose is None:
        return None
    return Pose(np.array(message.pose[:3]), Rotation(*message.pose[3:]))
