"""The time before each frame: bounded, and steady against single frames that are off."""

from __future__ import annotations

from itertools import accumulate

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.frame_interval import (
    LONGEST_NS,
    SHORTEST_NS,
    FrameIntervals,
    FrameTime,
    freeze_ns,
)
from tests.video.camera_times import camera_times_ns

pytestmark = pytest.mark.untimed

FIRST_NS = NS_PER_S // 30


def watched(times_ns: list[int]) -> list[FrameTime]:
    intervals = FrameIntervals(FIRST_NS)
    return [intervals.step(t_ns) for t_ns in times_ns]


@given(st.lists(st.integers(0, 5 * NS_PER_S), max_size=60))
def test_whatever_a_camera_does_its_interval_stays_within_bounds(steps_ns: list[int]) -> None:
    for time in watched(list(accumulate(steps_ns, initial=NS_PER_S))):
        assert SHORTEST_NS <= time.usual_ns <= LONGEST_NS
        assert SHORTEST_NS <= time.elapsed_ns <= LONGEST_NS


@given(st.lists(st.integers(10 * NS_PER_MS, 5 * NS_PER_S), max_size=60))
def test_no_frame_is_paid_more_than_the_time_that_has_passed(steps_ns: list[int]) -> None:
    times = watched(list(accumulate(steps_ns, initial=NS_PER_S)))[1:]
    assert all(time.paid_ns <= step for time, step in zip(times, steps_ns, strict=True))
    assert all(time.paid_ns <= 1.5 * time.usual_ns + 1 for time in times)
    assert all(time.paid_ns <= time.counted_ns <= time.elapsed_ns for time in times)


@given(st.floats(5.0, 60.0))
def test_at_a_constant_rate_the_interval_is_the_cameras(rate_hz: float) -> None:
    for time in watched(camera_times_ns((rate_hz, 2)))[1:]:
        assert time.usual_ns == pytest.approx(NS_PER_S / rate_hz, abs=1)
        assert time.paid_ns == time.counted_ns == time.elapsed_ns


@given(st.floats(5.0, 60.0), st.floats(5.0, 60.0))
def test_a_change_of_the_rate_is_followed_from_the_second_interval(
    before_hz: float, after_hz: float
) -> None:
    times_ns = camera_times_ns((before_hz, 1), (after_hz, 1))
    second = round(before_hz) + 1
    after = watched(times_ns)[second + 1 :]
    assert all(time.usual_ns == pytest.approx(NS_PER_S / after_hz, abs=2) for time in after)


def test_a_missed_frame_is_counted_and_the_next_is_not_twice_as_large() -> None:
    times_ns = camera_times_ns((30, 1))
    del times_ns[10]
    time = watched(times_ns)[10]
    assert time.usual_ns == pytest.approx(FIRST_NS, abs=1)
    assert time.paid_ns == pytest.approx(1.5 * FIRST_NS, abs=2)
    assert time.counted_ns == pytest.approx(2 * FIRST_NS, abs=2)


def test_a_gap_is_neither_paid_nor_counted() -> None:
    times_ns = camera_times_ns((30, 1))
    after_gap = watched([*times_ns, times_ns[-1] + 3 * NS_PER_S])[-1]
    assert after_gap.counted_ns == pytest.approx(2 * FIRST_NS, abs=2)


@pytest.mark.parametrize(("rate_hz", "freeze_ms"), [(60, 200), (30, 200), (15, 200), (5, 500)])
def test_a_freeze_is_200_ms_or_two_missing_frames(rate_hz: int, freeze_ms: int) -> None:
    assert freeze_ns(NS_PER_S // rate_hz) == freeze_ms * NS_PER_MS
