"""Time and the fixed rate."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.runtime.clock import FixedRate, VirtualClock

pytestmark = pytest.mark.waiting


def test_a_virtual_clock_sleeps_by_moving_and_never_goes_back():
    clock = VirtualClock(100)
    clock.sleep_until_ns(500)
    clock.sleep_until_ns(200)
    assert clock.now_ns() == 500
    with pytest.raises(ValueError, match="does not go back"):
        clock.advance_ns(-1)


def test_a_rate_must_be_positive():
    with pytest.raises(ValueError, match="positive"):
        FixedRate(VirtualClock(), 0)


@given(st.lists(st.integers(0, 60_000_000), max_size=50))
def test_deadlines_stay_on_the_grid_and_every_missed_period_is_counted(work_ns):
    clock = VirtualClock(7)
    rate = FixedRate(clock, 120)
    dues = []
    for duration_ns in work_ns:
        dues.append(rate.wait())
        assert clock.now_ns() >= dues[-1]
        assert clock.now_ns() - dues[-1] < rate.period_ns
        clock.advance_ns(duration_ns)
    assert all((due - 7) % rate.period_ns == 0 for due in dues)
    if dues:
        assert (dues[-1] - 7) // rate.period_ns == len(dues) + rate.skipped


def test_a_loop_that_keeps_up_skips_nothing():
    clock = VirtualClock()
    rate = FixedRate(clock, 120)
    for _ in range(100):
        rate.wait()
        clock.advance_ns(rate.period_ns - 1)
    assert rate.skipped == 0
