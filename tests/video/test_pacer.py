"""When paced packets leave."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.pacer import Pacer

pytestmark = pytest.mark.untimed

SIZES = st.lists(st.integers(60, 1500), max_size=60)


def test_a_frame_is_spread_over_two_thirds_of_the_time_that_the_link_takes() -> None:
    pacer = Pacer(6000.0)
    sizes = [1240] * 20
    leaves = [pacer.reserve(0, sum(sizes[part])) for part in pacer.parts(sizes)]
    assert leaves[0] == 0
    assert leaves == sorted(set(leaves))
    carried_ns = sum(sizes) * 8e6 / 6000.0
    assert pacer.reserve(0, 1) == pytest.approx(carried_ns / 1.5, rel=1e-6)


def test_a_higher_estimate_lets_what_asks_next_leave_closer_together() -> None:
    pacer = Pacer(1000.0)
    slow_ns = pacer.reserve(0, 1240) or pacer.reserve(0, 1240)
    pacer.set(10_000.0)
    first_ns = pacer.reserve(0, 1240)
    assert 0 < pacer.reserve(0, 1240) - first_ns < slow_ns / 5


def test_in_an_outage_small_frames_do_not_pile_up() -> None:
    pacer = Pacer(0.0)
    for turn in range(100):  # three views, four frames a second each
        now_ns = turn * 80 * NS_PER_MS
        assert pacer.reserve(now_ns, 1500) == now_ns


def test_at_the_most_that_the_estimate_may_be_a_frame_leaves_at_once() -> None:
    pacer = Pacer(1000.0, most_kbps=20_000.0)
    pacer.set(19_999.0)
    sizes = [1240] * 100
    assert len(pacer.parts(sizes)) > 5
    pacer.set(20_000.0)
    assert len(pacer.parts(sizes)) == 1
    now_ns = NS_PER_S
    assert pacer.reserve(now_ns, sum(sizes)) == now_ns
    assert pacer.reserve(now_ns, sum(sizes)) - now_ns < NS_PER_MS / 1000
    assert pacer.waiting_bytes(now_ns + NS_PER_MS) == 0.0


@given(SIZES, st.floats(0.0, 50_000.0))
def test_every_packet_is_in_one_part_in_order(sizes: list[int], kbps: float) -> None:
    parts = Pacer(kbps).parts(sizes)
    assert [size for part in parts for size in sizes[part]] == sizes
    assert all(part.stop > part.start for part in parts)


@given(
    st.lists(st.tuples(st.integers(0, 100 * NS_PER_MS), st.integers(60, 60_000)), max_size=40),
    st.floats(60.0, 50_000.0),
)
def test_nothing_leaves_early_out_of_order_or_later_than_what_waits_before_it_takes(
    asks: list[tuple[int, int]], kbps: float
) -> None:
    pacer, now_ns, last_ns = Pacer(kbps), 0, 0
    for pause_ns, size_bytes in asks:
        now_ns += pause_ns
        waiting_ns = pacer.waiting_bytes(now_ns) * 8e6 / (1.5 * max(kbps, 200 / 1.5))
        leaves_ns = pacer.reserve(now_ns, size_bytes)
        assert leaves_ns >= max(now_ns, last_ns)
        assert leaves_ns - now_ns == pytest.approx(waiting_ns, abs=10)
        last_ns = leaves_ns
