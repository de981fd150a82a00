"""Whether this machine can keep real time at this moment, measured before a test and not after it.

A test of a whole session in real time asks for the fixture `real_time`. It measures how late a
120 Hz loop wakes up beside whatever else the machine is doing, waits a while for a quieter moment,
and skips the test if none comes. What happens in the test itself is never a reason to skip.
"""

from __future__ import annotations

import time

import pytest

PERIOD_S = 1 / 120
WORK_S = 0.003  # processor time of a control tick on a slow machine
MEASURED_S = 0.3
LATE_S = 0.005
MOST_LATE = 0.10  # share of the ticks
LOOK_S = 1.0
WAIT_S = 120.0  # of the whole run: a machine that stays busy does not hold it up for ever


# What is left of the looks that one run may take while it waits for a quiet machine.
_looks = iter(range(round(WAIT_S / LOOK_S)))


def share_late() -> float:
    """Run an ordinary loop of 120 Hz with a tick's work: the share of ticks that were late.

    Late is a tick that began or ended more than LATE_S after it should have.
    """
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
    return late / ticks


def require_real_time() -> None:
    """Skip the test, before it begins, on a machine that does not keep time now."""
    while (late := share_late()) > MOST_LATE and next(_looks, None) is not None:
        time.sleep(LOOK_S)
    if late > MOST_LATE:
        pytest.skip(f"measured beforehand: this machine is busy, {late:.0%} of ticks late")
