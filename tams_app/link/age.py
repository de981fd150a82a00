"""How old what was heard is at most, and when it happened, without clocks that agree.

Everything here goes by stamps of the two monotonic clocks, whose difference is not known.
"""

from __future__ import annotations

from collections import deque
from dataclasses import dataclass

from tams_app.units import NS_PER_S

_WINDOW_NS = 10 * NS_PER_S  # two clocks of ±50 ppm drift apart by at most a millisecond


def age_bound_ns(heard_ns: int, echo_ns: int, awake_ns: int = 0) -> int | None:
    """The age that a message cannot exceed when it is heard: it is no older than its echo.

    `echo_ns`: our own stamp that it carries. None where it tells nothing: before the first, and for
    a stamp that we cannot have sent yet. And for one from before `awake_ns`, when our computer was
    suspended last: our clock stood still then.
    """
    if echo_ns <= 0 or echo_ns > heard_ns or echo_ns < awake_ns:
        return None
    return heard_ns - echo_ns


class LeastOffset:
    """The least difference between two stamps of a message over the last `window_ns`.

    Of the time when messages are heard and their `sent_ns` it is the offset of the clocks plus the
    shortest delay on the way: what it is added to is as if nothing had been queued.
    """

    def __init__(self, window_ns: int) -> None:
        self._window_ns = window_ns
        self._least: deque[tuple[int, int]] = deque()  # (when, difference), rising differences

    def step(self, now_ns: int, difference_ns: int) -> int:
        """Take one in; the least one now [ns]."""
        least = self._least
        while least and now_ns - least[0][0] > self._window_ns:
            least.popleft()
        while least and least[-1][1] >= difference_ns:
            least.pop()
        least.append((now_ns, difference_ns))
        return least[0][1]


@dataclass(frozen=True, slots=True)
class ClockOffset:
    """The other side's clock minus ours, and how far from the truth that may be [ns]."""

    t_ns: int
    offset_ns: int
    uncertainty_ns: int


class OffsetEstimate:
    """The clocks' offset from the exchange with the shortest round trip (as NTP, RFC 5905, 10).

    Half of that round trip is the uncertainty: the way there may have taken any part of it.
    """

    def __init__(self) -> None:
        self._best: deque[tuple[int, int, int]] = deque()  # (when, round trip, offset)

    def step(self, sent_ns: int, there_ns: int, back_ns: int, heard_ns: int) -> ClockOffset | None:
        """One exchange: we sent, the other side heard and sent, we heard; each on its own clock."""
        round_trip_ns = (heard_ns - sent_ns) - (back_ns - there_ns)
        if round_trip_ns < 0 or sent_ns <= 0 or there_ns <= 0:
            return self.now
        offset_ns = ((there_ns - sent_ns) + (back_ns - heard_ns)) // 2
        best = self._best
        while best and heard_ns - best[0][0] > _WINDOW_NS:
            best.popleft()
        while best and best[-1][1] >= round_trip_ns:
            best.pop()
        best.append((heard_ns, round_trip_ns, offset_ns))
        return self.now

    @property
    def now(self) -> ClockOffset | None:
        """The estimate; None before the first exchange."""
        if not self._best:
            return None
        when_ns, round_trip_ns, offset_ns = self._best[0]
        return ClockOffset(when_ns, offset_ns, -(-round_trip_ns // 2))
