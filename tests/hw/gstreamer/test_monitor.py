"""Freeze detection, and capture indices as places on a fixed time grid, in virtual time."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.gstreamer.monitor import (
    REMEMBERED,
    REPETITION_NS,
    START_TIMEOUT_NS,
    CaptureGrid,
    FrameStatus,
    FreezeWatch,
)
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

FPS = 30
PERIOD_NS = NS_PER_S // FPS
OPENED_NS = 7 * NS_PER_S


@pytest.fixture
def watch() -> FreezeWatch:
    watch = FreezeWatch(noisy=True)
    watch.opened(OPENED_NS)
    return watch


def test_a_camera_is_silent_half_a_second_after_its_last_frame_later_where_it_was_just_opened(
    watch: FreezeWatch,
) -> None:
    assert watch.silent_from_ns() == OPENED_NS + START_TIMEOUT_NS
    watch.frame(OPENED_NS + 900 * NS_PER_MS, b"a")
    assert watch.silent_from_ns() == OPENED_NS + 1400 * NS_PER_MS


def test_frames_that_differ_in_one_bit_are_seen(watch: FreezeWatch) -> None:
    for number in range(90):
        frame = b"same" * 100 + bytes([number])
        assert watch.frame(OPENED_NS + number * PERIOD_NS, frame) is FrameStatus.NEW


def test_a_frame_that_comes_again_is_left_out_at_once(watch: FreezeWatch) -> None:
    assert watch.frame(OPENED_NS, b"a") is FrameStatus.NEW
    assert watch.frame(OPENED_NS + PERIOD_NS, b"a") is FrameStatus.REPEATED
    assert watch.frame(OPENED_NS + 2 * PERIOD_NS, b"b") is FrameStatus.NEW
    assert watch.frame(OPENED_NS + 3 * PERIOD_NS, b"a") is FrameStatus.REPEATED


@pytest.mark.parametrize("buffers", [2, 4, REMEMBERED])
def test_old_buffers_in_turn_are_left_out_and_then_a_frozen_sensor(
    watch: FreezeWatch, buffers: int
) -> None:
    sights = [
        watch.frame(OPENED_NS + number * PERIOD_NS, bytes([number % buffers]))
        for number in range(60)
    ]
    assert set(sights[:buffers]) == {FrameStatus.NEW}
    assert set(sights[buffers:30]) == {FrameStatus.REPEATED}
    assert sights[-1] is FrameStatus.FROZEN


def test_no_new_frame_for_more_than_a_second_is_a_frozen_sensor(watch: FreezeWatch) -> None:
    at = OPENED_NS
    assert watch.frame(at, b"a") is FrameStatus.NEW
    assert watch.frame(at + REPETITION_NS, b"a") is FrameStatus.REPEATED
    assert watch.frame(at + REPETITION_NS + 1, b"a") is FrameStatus.FROZEN
    assert REPETITION_NS == NS_PER_S


def test_reopening_does_not_make_the_same_frame_a_new_one(watch: FreezeWatch) -> None:
    for number in range(60):
        watch.frame(OPENED_NS + number * PERIOD_NS, b"a")
    reopened_ns = OPENED_NS + 3 * NS_PER_S
    watch.opened(reopened_ns)
    # nor one that is left over from before a reason to close the camera again at once
    assert watch.frame(reopened_ns + PERIOD_NS, b"a") is FrameStatus.REPEATED
    assert watch.frame(reopened_ns + REPETITION_NS + 1, b"a") is FrameStatus.FROZEN
    assert watch.frame(reopened_ns + REPETITION_NS + PERIOD_NS, b"b") is FrameStatus.NEW


# --- the grid ------------------------------------------------------------------------------------


def indices(times_ns: list[int]) -> list[int | None]:
    grid = CaptureGrid(FPS)
    return [grid.index(time_ns) for time_ns in times_ns]


def test_jitter_of_a_third_of_a_period_does_not_matter() -> None:
    jitter = [0, 10, -10, 5, 0, -10, 10, -10, 10, 0]
    times = [n * PERIOD_NS + ms * NS_PER_MS // 2 for n, ms in enumerate(jitter * 20)]
    assert indices(times) == list(range(200))


@pytest.mark.parametrize(("ppm", "slips"), [(0, 0), (2000, 2), (-2000, 2), (300, 0)])
def test_a_camera_with_an_inexact_clock_slips_one_place_at_a_time(ppm: int, slips: int) -> None:
    frames = 900
    jitter = (0, 4, -4, 2, -1)
    times = [
        n * PERIOD_NS * (1_000_000 + ppm) // 1_000_000 + jitter[n % 5] * NS_PER_MS
        for n in range(frames)
    ]
    given_places = indices(times)
    kept = [place for place in given_places if place is not None]
    left_out = given_places.count(None)
    empty = kept[-1] + 1 - len(kept)
    assert left_out + empty == slips


def test_a_camera_twice_as_fast_loses_every_second_frame() -> None:
    kept = [
        place for place in indices([n * PERIOD_NS // 2 for n in range(200)]) if place is not None
    ]
    assert kept == list(range(len(kept)))
    assert len(kept) == pytest.approx(100, abs=1)


@given(st.lists(st.integers(-PERIOD_NS, 40 * PERIOD_NS), max_size=200))
def test_no_place_is_given_twice_and_none_is_far_from_the_time(steps_ns: list[int]) -> None:
    grid = CaptureGrid(FPS)
    time_ns = start_ns = 10 * NS_PER_S
    places = []
    for step_ns in [0, *steps_ns]:
        time_ns += step_ns
        place = grid.index(time_ns)
        if place is not None:
            assert abs((time_ns - start_ns) * FPS / NS_PER_S - place) <= 0.75
            places.append(place)
    assert all(later > earlier for earlier, later in pairwise(places))
