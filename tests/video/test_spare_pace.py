"""Spare pace: slow at once when the machine is full, faster again little by little."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.station.quality_process import LARGEST_SHARE, LEAST_SHARE, SparePace
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed

WORK_NS = 10 * NS_PER_MS


def paced(idles: list[float]) -> list[float]:
    """The share after each look at the machine."""
    at = iter(idles)
    pace = SparePace(lambda: next(at), 0)
    shares = []
    for second in range(1, len(idles) + 1):
        pace.rest_ns(WORK_NS, second * NS_PER_S)
        shares.append(pace.share)
    return shares


def test_it_begins_with_little_and_grows_to_half_a_core_where_cores_are_idle() -> None:
    shares = paced([0.4] * 20)
    assert shares[0] < 0.1
    assert shares == sorted(shares)
    assert shares[-1] == LARGEST_SHARE


def test_a_full_machine_halves_it_at_each_look_down_to_a_few_frames_a_second() -> None:
    shares = paced([0.4] * 20 + [0.0] * 5)
    assert shares[20:23] == [0.25, 0.125, 0.0625]
    assert shares[-1] == LEAST_SHARE


def test_between_scarce_and_ample_it_stays() -> None:
    assert len(set(paced([0.07] * 5))) == 1


def test_the_machine_is_looked_at_twice_a_second_however_short_the_work() -> None:
    looks = []

    def idle() -> float:
        looks.append(1)
        return 0.5

    pace = SparePace(idle, 0)
    for step in range(1, 101):
        pace.rest_ns(WORK_NS, step * 10 * NS_PER_MS)
    assert len(looks) == 2


@given(st.lists(st.floats(0, 1), max_size=40), st.integers(0, NS_PER_S))
def test_work_never_takes_more_than_half_of_the_time(idles: list[float], worked_ns: int) -> None:
    at = iter([*idles, 1.0])
    pace = SparePace(lambda: next(at), 0)
    for second in range(1, len(idles) + 2):
        rest_ns = pace.rest_ns(worked_ns, second * NS_PER_S)
        assert rest_ns >= worked_ns
        assert LEAST_SHARE <= pace.share <= LARGEST_SHARE
