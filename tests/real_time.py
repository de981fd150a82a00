"""Whether this machine can keep real time at this moment, measured before a test and not after it.

A test of a whole session in real time asks for the fixture `real_time`. It measures how late a
120 Hz loop wakes up beside whatever else the machine is doing, waits a while for a quieter moment,
and skips the test if none comes. What happens in the test itself is never a reason to skip.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import pytest

PERIOD_S = 1 / 120
WORK_S = 0.003  # processor time of a control tick on a slow machine
MEASURED_S = 0.3
LATE_S = 0.005
MOST_LATE = 0.10  # share of the ticks
LOOK_S = 1.0
WAIT_S = 120.0  # of the whole run: a machine that stays busy does not hold it up for ever


@dataclass(frozen=True, slots=True)
class Measurement:
    """One look at the machine."""

    late: float  # share of ticks that began or ended more than LATE_S after they should have

    @property
    def keeps_time(self) -> bool:
        return self.late <= MOST_LATE


def measure() -> Measurement:
    """Run an ordinary loop of 120 Hz with a tick's work for half a second."""
    ticks = round(MEASURED_S / PERIOD_S)
    late = 0
    due_s = time.monotonic() + PERIOD_S
    for _ in range(ticks):
        time.sleep(max(0.0, due_s - time.monotonic()))
        busy_until_s = time.thread_time() + WORK_S
        while time.thread_time() < busy_until_s:
            pass
        late += time.monotonic() > due_s + WORK_S + LATE_S
        due_s = max(due_s + PERIOD_S, time.monotonic())
    return Measurement(late / ticks)


class Waiting:
    """What is left of the time that one run may wait for a quiet machine."""

    def __init__(self, measure: Callable[[], Measurement], sleep: Callable[[float], None]) -> None:
        self._measure = measure
        self._sleep = sleep
        self._left_s = WAIT_S

    def until_quiet(self) -> Measurement:
        """The first measurement that keeps time, or one that does not once the time is spent."""
        while not (seen := self._measure()).keeps_time and self._left_s > 0.0:
            self._sleep(LOOK_S)
            self._left_s -= LOOK_S
        return seen


_waiting = Waiting(measure, time.sleep)


def require_real_time() -> None:
    """Skip the test, before it begins, on a machine that does not keep time now."""
    seen = _waiting.until_quiet()
    if not seen.keeps_time:
        pytest.skip(f"measured beforehand: this machine is busy, {seen.late:.0%} of ticks late")
