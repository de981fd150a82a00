"""A controller whose samples come over the link; missing ones are a status, as with any other.

Each rule about what may move the arm is one part, here in the order in which a sample passes them:

- `SampleGate`: may it count, by its age, order and form?
- `TransitFilter` and `HandTimes` (`hand_times`): when was its pose new, on our clock?
- `BreakWatch`: were too many missing before it (a hold)?
- `Presence`: is there a gap (a hold), or is the link lost or the operator gone (faults)?
"""

from __future__ import annotations

import math
from collections import Counter, deque
from collections.abc import Callable
from dataclasses import replace

from hw.controller import Controller
from hw.link.hand_times import HandTimes, Transit, TransitFilter
from tams_app.config import LinkConfig
from tams_app.link.age import PeerClock
from tams_app.link.gaps import Breaks
from tams_app.link.messages import HandMessage
from tams_app.records import ControllerSample, ControllerStatus, Haptic, Presses
from tams_app.units import NS_PER_MS

_STATUSES = {status.value: status for status in ControllerStatus}
_LOST = ControllerSample.released(ControllerStatus.LINK_LOST)
_NOT_STARTED = replace(_LOST, status=ControllerStatus.DISCONNECTED)
_GAP = replace(_LOST, status=ControllerStatus.LINK_GAP)
_AWAY = replace(_LOST, status=ControllerStatus.OPERATOR_AWAY)
_UNIT_TOLERANCE = 1e-3  # of a rotation's quaternion
_JITTER_SAMPLES, _LARGEST_JITTER_NS = 120, 25 * NS_PER_MS  # of one second


class SampleGate:
    """Gate for samples: those count that are young, answered, in order and well formed.

    Young: by `PeerClock.age_ns` no older than `LinkConfig.longest_age_ms`; what was queued in an
    outage is. Answered: echoing a stamp of ours no older than `longest_silence_ms`; who receives
    nothing echoes none.
    """

    def __init__(self, config: LinkConfig) -> None:
        self.clock = PeerClock()  # of the connected operator
        self._longest_age_ms = config.longest_age_ms
        self._longest_silence_ns = config.longest_silence_ms * NS_PER_MS
        self._newest_sent_ns: int | None = None  # of those that counted

    def refusal(self, message: HandMessage, received_ns: int) -> str:
        """The reason not to count it; "" if it counts, and from then on only newer ones do."""
        self.clock.step(message.echo_ns, message.echo_heard_ns, message.sent_ns, received_ns)
        refusal = self._untimely(message, received_ns)
        if refusal:
            return refusal
        if self._newest_sent_ns is not None and message.sent_ns <= self._newest_sent_ns:
            return "overtaken"
        refusal = _malformed(message)
        if not refusal:
            self._newest_sent_ns = message.sent_ns
        return refusal

    def forget(self) -> None:
        """The next sample is judged as the first."""
        self._newest_sent_ns = None

    def _untimely(self, message: HandMessage, received_ns: int) -> str:
        age_ns = self.clock.age_ns(message.sent_ns, message.echo_ns, received_ns)
        if age_ns is None:
            return "without an echo"
        round_trip_ns = self.clock.round_trip_ns
        round_trip_ms = None if round_trip_ns is None else round_trip_ns / NS_PER_MS
        if age_ns > self._longest_age_ms(round_trip_ms) * NS_PER_MS:
            return "too old"
        if received_ns - message.echo_ns > self._longest_silence_ns:
            return "unanswered"
        return ""


def _malformed(message: HandMessage) -> str:
    if max(message.pose_ns, message.buttons_ns) > message.sent_ns:
        return "from the future"
    if message.status not in _STATUSES:
        return "of unknown status"
    if message.pose is not None and not _is_rotation(message.pose[3:]):
        return "without a rotation"
    return ""


def _is_rotation(quaternion: tuple[float, ...]) -> bool:
    return abs(math.hypot(*quaternion) - 1.0) <= _UNIT_TOLERANCE  # never true of NaN


class BreakWatch:
    """Watch for three breaks within a second; the arm holds until that second is over.

    Otherwise an attacker who chooses what is lost could steer it. A break lasts while the newest
    sample that counts is older than `LinkConfig.bridge_ms`, and counts when it ends. Jitter extends
    that by the median excess over the transit time in use, at most 25 ms: the hand slows down, but
    no sample is missing.
    """

    def __init__(self, bridge_ms: float) -> None:
        self._bridge_ns = bridge_ms * NS_PER_MS
        self._breaks = Breaks()
        self._in_break = False
        self._newest_ns: int | None = None  # when the newest sample was sent, on our clock
        self._transits_ns: deque[int] = deque(maxlen=_JITTER_SAMPLES)
        self._used_ns = 0  # in use at the newest

    def step(self, sent_ns: int, received_ns: int, transit: Transit) -> bool:
        """Take in a sample that counts; True if it ends a break that makes too many."""
        was_in_break, self._in_break = self._in_break, self._is_break(received_ns)
        self._newest_ns = sent_ns + transit.used_ns
        if not transit.is_early:
            self._transits_ns.append(received_ns - sent_ns)
            self._used_ns = transit.used_ns
        return self._in_break and not was_in_break and self._breaks.add(received_ns)

    def too_many(self, now_ns: int) -> bool:
        """True while there are too many."""
        return self._breaks.too_many(now_ns)

    def _is_break(self, received_ns: int) -> bool:
        """True if the newest sample had become too old until the next was received."""
        if self._newest_ns is None:
            return False
        beyond_ns = received_ns - self._newest_ns - self._bridge_ns
        return beyond_ns > 0 and beyond_ns > self._jitter_ns()

    def _jitter_ns(self) -> int:
        median_ns = sorted(self._transits_ns)[len(self._transits_ns) // 2]
        return min(max(0, median_ns - self._used_ns), _LARGEST_JITTER_NS)


class Presence:
    """Presence of an operator.

    After `lost_after_ms` without a sample (early ones aside) there is a gap, after `fault_after_ms`
    the link is lost. A change of operator loses it at once, for one sample at least; one who left
    is away.
    """

    def __init__(self, config: LinkConfig) -> None:
        self.counted_ns: int | None = None  # when the newest sample, early ones aside, was received
        self._lost_after_ns = config.lost_after_ms * NS_PER_MS
        self._fault_after_ns = config.fault_after_ms * NS_PER_MS
        self._lost_from_ns = 0
        self._absent = _LOST
        self._let_go = False

    def let_go(self, left: bool) -> None:
        """The operator is another one from now on, or has `left`."""
        self._let_go, self._absent = True, _AWAY if left else _LOST
        self.counted_ns, self._lost_from_ns = None, 0

    def step(self, now_ns: int) -> ControllerSample | None:
        """The sample that stands for an absent operator's; None while one is present."""
        let_go, self._let_go = self._let_go, False
        if let_go:  # the next one may have been received since, but first the arm stops
            return self._absent
        counted_ns = self.counted_ns
        if counted_ns is not None and now_ns - counted_ns > self._lost_after_ns:
            self.counted_ns, self._lost_from_ns = None, counted_ns + round(self._fault_after_ns)
        if self.counted_ns is None:
            return _GAP if now_ns < self._lost_from_ns else self._absent
        return None


class LinkController(Controller):
    """The newest sample that may move the arm; `take` and `sample` are for the control thread."""

    def __init__(
        self,
        config: LinkConfig,
        receive: Callable[[int], None],
        pulse: Callable[[Haptic], None],
    ) -> None:
        """`receive` is called at the start of each `sample`, to `take` new messages."""
        self.refused: Counter[str] = Counter()  # samples that did not count, by reason
        self.too_often = 0  # how many breaks made too many
        self._config, self._receive, self._pulse = config, receive, pulse
        self._started = False
        self._sample = _LOST
        self._gate, self._presence = SampleGate(config), Presence(config)
        self._forget()

    @property
    def clock(self) -> PeerClock:
        """The connected operator's clock."""
        return self._gate.clock

    @property
    def counted_ns(self) -> int | None:
        """The time when the newest message whose pose counts was received; None: none counts."""
        return self._presence.counted_ns

    def start(self) -> None:
        self._started = True

    def sample(self, now_ns: int) -> ControllerSample:
        self._receive(now_ns)
        if not self._started:
            self._forget()
            return _NOT_STARTED
        absent = self._presence.step(now_ns)
        if absent is not None:
            if self.counted_ns is None:
                self._forget()
            return absent
        is_ok = self._sample.status is ControllerStatus.OK  # others stop the arm themselves
        if is_ok and self._breaks.too_many(now_ns):
            return replace(self._sample, status=ControllerStatus.LINK_GAPS)
        return self._sample

    def pulse(self, haptic: Haptic) -> None:
        if self._started:
            self._pulse(haptic)

    def close(self) -> None:
        self._started = False

    def take(self, message: HandMessage, received_ns: int) -> str:
        """Take a sample that was received at `received_ns`; "" if it counts, else why not."""
        refusal = self._gate.refusal(message, received_ns)
        if refusal:
            self.refused[refusal] += 1
            return refusal
        transit, times = self._transits.step(message.sent_ns, received_ns), self._times
        times.step(message, transit)
        self.too_often += self._breaks.step(message.sent_ns, received_ns, transit)
        if not transit.is_early:
            self._presence.counted_ns = received_ns
        self._sample = ControllerSample(
            _STATUSES[message.status],
            times.pose,
            times.pose_ns,
            times.buttons_ns,
            trigger=message.trigger,
            grip=message.grip,
            a=message.a,
            b=message.b,
            menu=message.menu,
            presses=Presses(*message.presses),
        )
        return ""

    def let_go(self, left: bool = False) -> None:
        """Forget the operator: for one sample at least they have `left`, or the link is lost."""
        self._presence.let_go(left)
        self.clock.forget()
        self._forget()

    def wake(self, now_ns: int) -> None:
        """This computer was suspended: the link is lost, and what is from before is too old."""
        self.let_go()
        self.clock.wake(now_ns)

    def _forget(self) -> None:
        """Judge the next sample as the first; the operator's clock stays the same."""
        self._gate.forget()
        self._presence.counted_ns = None
        self._transits = TransitFilter(self._config.jitter_ms)
        self._times = HandTimes()
        self._breaks = BreakWatch(self._config.bridge_ms)
