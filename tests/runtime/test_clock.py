"""Time and the fixed rate."""

from collections.abc import Sequence

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.runtime.clock import FixedRate, MonotonicClock, SleepWatch, VirtualClock
from tams_app.units import NS_PER_MS, NS_PER_S

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


class HeldUpReadings(VirtualClock):
    """Readings of the time asleep that are too little by what held each up."""

    def __init__(self, delays_ms: Sequence[float]) -> None:
        super().__init__()
        self._delays = iter(delays_ms)

    def suspended_ns(self) -> int:
        return super().suspended_ns() - round(next(self._delays, 0.0) * NS_PER_MS)


@given(st.lists(st.floats(0, 500), max_size=50), st.floats(0, 500))
def test_a_reading_that_was_held_up_is_no_sleep(delays_ms: list[float], again_ms: float) -> None:
    watch = SleepWatch(HeldUpReadings([again_ms, 0.0, again_ms, *delays_ms]))
    assert not any(watch.slept() for _ in range(60))


@given(st.integers(6, 10**9))
def test_a_sleep_is_noticed_once(slept_ms: int) -> None:
    clock = VirtualClock()
    watch = SleepWatch(clock)
    assert not watch.slept()
    clock.suspend_ns(slept_ms * NS_PER_MS)
    assert [watch.slept() for _ in range(3)] == [True, False, False]


def test_the_machines_clock_tells_how_long_it_was_asleep() -> None:
    clock = MonotonicClock()
    watch = SleepWatch(clock)
    assert clock.suspended_ns() >= -NS_PER_S
    assert not any(watch.slept() for _ in range(1000))
