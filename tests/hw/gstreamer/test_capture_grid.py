"""Capture indices: places on a fixed time grid."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.gstreamer.monitor import CaptureGrid
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

FPS = 30
PERIOD_NS = NS_PER_S // FPS


def indices(times_ns: list[int]) -> list[int | None]:
    grid = CaptureGrid(FPS)
    return [grid.index(time_ns) for time_ns in times_ns]


@pytest.mark.parametrize("missing", [1, 2, 7, 150])
def test_missed_frames_leave_a_gap(missing: int) -> None:
    grid = CaptureGrid(FPS)
    for number in range(10):
        grid.index(number * PERIOD_NS)
    assert grid.index((9 + missing + 1) * PERIOD_NS) == 9 + missing + 1


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
