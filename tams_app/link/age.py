"""The age of what was received, and its time on our clock, between clocks that do not agree.

Everything here goes by stamps of the two monotonic clocks, whose difference is not known.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

# The most that the clocks' rates differ while none is being put right: two crystals of 50 ppm, and
# what NTP keeps correcting of a rate (MAXFREQ in linux/timex.h). One that catches up is slewed far
# faster (chrony: up to 83,333 ppm, by the length of the tick), which is noticed: see `PeerClock`.
LARGEST_DRIFT = 500e-6


@dataclass(frozen=True, slots=True)
class ClockOffset:
    """The other side's clock minus ours, and how far from the truth that may be [ns]."""

    t_ns: int
    offset_ns: int
    uncertainty_ns: int


@dataclass(frozen=True, slots=True)
class _Interval:
    """The offset is certainly between these, at `t_ns` of our clock [ns]."""

    t_ns: int
    least_ns: int
    most_ns: int

    def at(self, now_ns: int) -> _Interval:
        """The same, widened by the drift until `now_ns`."""
        drift_ns = math.ceil(max(0, now_ns - self.t_ns) * LARGEST_DRIFT)
        return _Interval(max(now_ns, self.t_ns), self.least_ns - drift_ns, self.most_ns + drift_ns)


class PeerClock:
    """The other side's clock against ours, and with it the age of what was sent there.

    Each exchange (we sent, the other side received, it sent, we received) bounds the offset of the
    clocks: nothing was received before it was sent (as NTP has it, RFC 5905, 10, without the
    assumption that both ways take equally long). The intervals are intersected as exchanges come
    and widened by the drift, so that the fastest message of each way counts, and a queue on one way
    does not make older what comes on the other.

    An exchange that contradicts the interval (a clock was stepped, or runs away) voids it, and what
    we had sent until then counts for no other one. Until one does, an age may be short by what the
    other clock has gained, which is less than the fastest message has taken since, and what was
    gained after that one. A clock there that stands still makes later messages older; those that
    were sent before the newest exchange are judged by their echo alone. `wake` is for our own.
    """

    def __init__(self) -> None:
        self._interval: _Interval | None = None
        self._since_ns = 0  # an exchange that began before counts for no interval
        self._sent_from_ns = 0  # of what was sent before, on its clock, the interval says nothing
        self._awake_ns = 0

    def forget(self) -> None:
        """The other side is another one: nothing is known of its clock."""
        self._interval, self._sent_from_ns = None, 0

    def wake(self, now_ns: int) -> None:
        """Our computer was suspended, and our clock stood still: nothing from before counts."""
        self._awake_ns = now_ns
        self.forget()

    def step(self, echo_ns: int, echo_received_ns: int, sent_ns: int, received_ns: int) -> None:
        """Take in an exchange, in the order in which they end.

        Args:
            echo_ns: when we sent [ns, our clock]; 0: never.
            echo_received_ns: when the other side received it [ns, its clock].
            sent_ns: when it sent [ns, its clock].
            received_ns: when we received that [ns, our clock].
        """
        if self._by_echo_ns(echo_ns, received_ns) is None or echo_received_ns <= 0:
            return
        if echo_ns < self._since_ns:
            return
        found = _Interval(echo_ns, sent_ns - received_ns, echo_received_ns - echo_ns)
        found = found.at(received_ns)  # its bounds held at some time since we sent
        if self._interval is not None:
            before = self._interval.at(received_ns)
            least_ns = max(before.least_ns, found.least_ns)
            found = _Interval(found.t_ns, least_ns, min(before.most_ns, found.most_ns))
        if echo_received_ns > sent_ns or found.least_ns > found.most_ns:
            self.forget()
            self._since_ns = received_ns + 1
        else:
            self._interval = found
            self._sent_from_ns = max(self._sent_from_ns, echo_received_ns)

    def age_ns(self, sent_ns: int, echo_ns: int, now_ns: int) -> int | None:
        """The age that a message cannot exceed: by its echo, or by the clocks if that is less.

        Args:
            sent_ns: when the other side sent it [ns, its clock].
            echo_ns: our newest stamp that had been received there [ns, our clock].
            now_ns: the time [ns, our clock].

        Returns:
            The bound [ns]; None where nothing bounds it: before the first echo, for one that we
            cannot have sent yet, or sent before our computer was suspended.
        """
        by_echo_ns = self._by_echo_ns(echo_ns, now_ns)
        if by_echo_ns is None or self._interval is None or sent_ns < self._sent_from_ns:
            return by_echo_ns
        by_clock_ns = now_ns - sent_ns + self._interval.at(now_ns).most_ns
        if by_clock_ns < 0:  # by its clock it is yet to be sent
            return by_echo_ns
        return min(by_echo_ns, by_clock_ns)

    @property
    def offset(self) -> ClockOffset | None:
        """The middle of the interval, when it was found; None before the first exchange."""
        found = self._interval
        if found is None:
            return None
        width_ns = found.most_ns - found.least_ns
        return ClockOffset(found.t_ns, found.least_ns + width_ns // 2, -(-width_ns // 2))

    @property
    def round_trip_ns(self) -> int | None:
        """The time of the fastest messages of both ways together, at most; None: not known."""
        found = self._interval
        return None if found is None else found.most_ns - found.least_ns

    def _by_echo_ns(self, echo_ns: int, now_ns: int) -> int | None:
        """The time since our stamp was sent; None for one that cannot be."""
        if echo_ns <= 0 or echo_ns > now_ns or echo_ns < self._awake_ns:
            return None
        return now_ns - echo_ns


class LeastOffset:
    """The least difference between two stamps of a message over the last `window_ns`.

    Of the time when messages are received and their `sent_ns` it is the offset of the clocks plus
    the shortest delay on the way: what it is added to is as if nothing had been queued.
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
