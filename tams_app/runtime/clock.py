"""Time as integer nanoseconds of one monotonic clock, real or virtual, and the fixed-rate pacer."""

from __future__ import annotations

import time
from typing import Protocol

from tams_app.units import NS_PER_MS, NS_PER_S

_SLEPT_NS = 5 * NS_PER_MS
_FIRST_READINGS = 5


class Clock(Protocol):
    """A monotonic clock; every `*_ns` of the application comes from one of these."""

    def now_ns(self) -> int:
        """Nanoseconds since an arbitrary start, never going back."""

    def sleep_until_ns(self, deadline_ns: int) -> None:
        """Sleep until a time.

        Args:
            deadline_ns: when to return at the earliest [ns]; at once if it has passed.
        """

    def suspended_ns(self) -> int:
        """For how long the computer has been suspended so far [ns]: this clock stood still then.

        Never too much, but too little by what passes while it is found out.
        """


class MonotonicClock:
    """The machine's CLOCK_MONOTONIC, which all processes of one host share."""

    def now_ns(self) -> int:
        return time.monotonic_ns()

    def sleep_until_ns(self, deadline_ns: int) -> None:
        remaining_ns = deadline_ns - time.monotonic_ns()
        if remaining_ns > 0:
            time.sleep(remaining_ns / NS_PER_S)

    def suspended_ns(self) -> int:
        return time.clock_gettime_ns(time.CLOCK_BOOTTIME) - time.monotonic_ns()  # in this order


class VirtualClock:
    """A clock that moves only on request; sleeping moves it."""

    def __init__(self, start_ns: int = NS_PER_S) -> None:
        self._now_ns = start_ns
        self._suspended_ns = 0

    def now_ns(self) -> int:
        return self._now_ns

    def sleep_until_ns(self, deadline_ns: int) -> None:
        self._now_ns = max(self._now_ns, deadline_ns)

    def advance_ns(self, duration_ns: int) -> None:
        """Move on by `duration_ns` >= 0."""
        if duration_ns < 0:
            raise ValueError("time does not go back")
        self._now_ns += duration_ns

    def suspended_ns(self) -> int:
        return self._suspended_ns

    def suspend_ns(self, duration_ns: int) -> None:
        """As a computer that sleeps for `duration_ns` >= 0: this clock stands still."""
        self._suspended_ns += duration_ns


class SleepWatch:
    """Notices that the computer was suspended, which no monotonic clock shows."""

    def __init__(self, clock: Clock) -> None:
        self._clock = clock
        # of each reading too little by what held it up: the highest one is nearest
        self._known_ns = max(clock.suspended_ns() for _ in range(_FIRST_READINGS))

    def slept(self) -> bool:
        """True if it was since the last call, for more than 5 ms."""
        suspended_ns = self._clock.suspended_ns()
        before_ns, self._known_ns = self._known_ns, max(self._known_ns, suspended_ns)
        return suspended_ns - before_ns > _SLEPT_NS


class FixedRate:
    """Absolute deadlines of a periodic loop; a missed period is skipped, never caught up.

    A tick is due at `start + n·period`. When the loop falls a whole period or more behind,
    the periods that have passed are counted as `skipped` and the next deadline lies ahead.
    """

    def __init__(self, clock: Clock, rate_hz: float) -> None:
        if rate_hz <= 0:
            raise ValueError("a rate must be positive")
        self._clock = clock
        self.period_ns = round(NS_PER_S / rate_hz)
        self._due_ns = clock.now_ns()
        self.skipped = 0

    def wait(self) -> int:
        """Sleep to the next deadline and return it [ns]."""
        self._due_ns += self.period_ns
        behind_ns = self._clock.now_ns() - self._due_ns
        if behind_ns >= self.period_ns:
            missed = behind_ns // self.period_ns
            self.skipped += missed
            self._due_ns += missed * self.period_ns
        self._clock.sleep_until_ns(self._due_ns)
        return self._due_ns
