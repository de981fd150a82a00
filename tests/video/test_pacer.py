"""When packets leave, and the bound on data in flight: who gives way, and who never starves."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.pacer import LONGEST_WAIT_NS, FlightBound, Pacer, view_limits

pytestmark = pytest.mark.untimed

SIZES = st.lists(st.integers(60, 1500), max_size=60)


def test_a_frame_is_spread_over_two_thirds_of_the_time_that_the_link_takes() -> None:
    pacer = Pacer(6000.0)
    sizes = [1240] * 20
    leaves = [leaves_ns for leaves_ns, _ in pacer.schedule(0, sizes)]
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
    st.floats(0.0, 50_000.0),
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


# --- the bound on data in flight ------------------------------------------------------------------

VIEWS = ("eih", "gt", "gs")
FRAME_NS = NS_PER_S // 90  # the views take turns
TARGETS = st.fixed_dictionaries(
    {view: st.floats(80.0, 20_000.0) | st.just(900.0) for view in VIEWS}
)


def kept(
    bound: FlightBound, sent_bytes: list[int], reported_ns: list[int] | None = None
) -> list[tuple[int, str]]:
    """Time and view of the frames that are not left out, of three views in turn."""
    found = []
    for turn, sent in enumerate(sent_bytes):
        now_ns, view = NS_PER_S + turn * FRAME_NS, VIEWS[turn % 3]
        told = reported_ns[turn] if reported_ns else 0
        if not bound.exceeded(view, now_ns, sent, told):
            found.append((now_ns, view))
    return found


@given(st.floats(6000.0, 1e6), TARGETS)
def test_a_view_with_a_larger_target_never_gives_way_before_one_with_a_smaller(
    limit_bytes: float, targets: dict[str, float]
) -> None:
    limits = view_limits(limit_bytes, targets)
    assert limits.keys() == targets.keys()
    assert min(limits.values()) == limit_bytes
    assert max(limits.values()) <= 1.25 * limit_bytes
    for one in VIEWS:
        for other in VIEWS:
            assert (targets[one] < targets[other]) == (limits[one] < limits[other])


@given(st.lists(st.integers(0, 20_000), min_size=3, max_size=300), TARGETS)
def test_what_stays_below_the_bound_loses_no_frame(
    sizes: list[int], targets: dict[str, float]
) -> None:
    bound = FlightBound(VIEWS)
    bound.set(sum(sizes), targets)
    sent = [sum(sizes[:turn]) for turn in range(len(sizes))]
    assert len(kept(bound, sent)) == len(sizes)


def test_what_the_pacer_keeps_back_counts_as_under_way() -> None:
    bound = FlightBound(VIEWS)
    bound.set(10_000.0, dict.fromkeys(VIEWS, 500.0))
    assert not bound.exceeded("eih", NS_PER_S, 6000, 0)
    assert not bound.exceeded("eih", NS_PER_S + FRAME_NS, 6000, 0, 9000.0)
    assert bound.exceeded("eih", NS_PER_S + 2 * FRAME_NS, 6000, 0, 11_000.0)


def test_before_a_bound_is_set_and_with_an_infinite_one_no_frame_is_left_out() -> None:
    assert len(kept(FlightBound(VIEWS), [10**9 * turn for turn in range(90)])) == 90


def test_beyond_the_bound_the_small_views_give_way_and_then_the_primary() -> None:
    def left_out(under_way: int) -> set[str]:
        bound = FlightBound(VIEWS)
        bound.set(100_000.0, {"eih": 3000.0, "gt": 900.0, "gs": 600.0})
        for turn, view in enumerate(VIEWS):  # a frame of each before
            bound.exceeded(view, NS_PER_S + turn, 0, 0)
        later_ns = NS_PER_S + 50 * NS_PER_MS
        return {view for view in VIEWS if bound.exceeded(view, later_ns, under_way, 0)}

    assert left_out(100_000) == set()
    assert left_out(100_001) == {"gs"}
    assert left_out(112_501) == {"gs", "gt"}
    assert left_out(125_001) == set(VIEWS)


@settings(max_examples=40)
@given(st.lists(st.integers(0, 10**7), min_size=100, max_size=400), TARGETS)
def test_no_view_waits_longer_than_the_longest_wait_and_a_frame_whatever_is_under_way(
    increments: list[int], targets: dict[str, float]
) -> None:
    bound = FlightBound(VIEWS)
    bound.set(6000.0, targets)
    sent = [sum(increments[:turn]) for turn in range(len(increments))]
    found = kept(bound, sent)
    end_ns = NS_PER_S + len(sent) * FRAME_NS
    for view in VIEWS:
        times_ns = [t_ns for t_ns, one in found if one == view] + [end_ns]
        assert all(b - a < LONGEST_WAIT_NS + 3 * FRAME_NS for a, b in pairwise(times_ns))


@given(TARGETS)
def test_after_an_outage_all_views_send_again_as_soon_as_anything_newer_is_told_of(
    targets: dict[str, float],
) -> None:
    bound = FlightBound(VIEWS)
    bound.set(6000.0, targets)
    turns, back = 300, 200
    sent = [min(turn, 90) * 5000 for turn in range(turns)]
    heard_ns = NS_PER_S + back * FRAME_NS
    told = [0 if turn <= back else heard_ns for turn in range(turns)]
    found = kept(bound, sent, told)
    assert len([t_ns for t_ns, _ in found if t_ns <= heard_ns]) < back // 3
    assert len([t_ns for t_ns, _ in found if t_ns > heard_ns]) == turns - back - 1


@given(st.lists(st.tuples(st.integers(0, 30), st.integers(0, 3000)), min_size=2, max_size=60))
def test_under_way_is_what_left_after_the_newest_packet_told_of(
    steps: list[tuple[int, int]],
) -> None:
    bound = FlightBound(VIEWS)
    now_ns = sent = reported_ns = 0
    history = []
    for place, (step_ms, size) in enumerate(steps):
        now_ns += step_ms * NS_PER_MS
        history.append((now_ns, sent))
        if place % 7 == 6:
            reported_ns = history[place // 2][0]
        told = next(before for t_ns, before in history if t_ns >= reported_ns)
        bound.set(sent - told, dict.fromkeys(VIEWS, 900.0))
        bound.exceeded("eih", now_ns, sent, reported_ns)
        assert bound.admits_retransmission(0)
        assert not bound.admits_retransmission(1)
        sent += size


def test_packets_are_sent_again_while_the_bound_has_room_and_each_takes_some() -> None:
    bound = FlightBound(VIEWS)
    assert bound.admits_retransmission(1200)
    bound.set(10_000.0, dict.fromkeys(VIEWS, 900.0))
    bound.exceeded("eih", NS_PER_S, 0, 0)
    bound.exceeded("eih", NS_PER_S + FRAME_NS, 7000, 0)
    assert [bound.admits_retransmission(1200) for _ in range(4)] == [True, True, False, False]
    bound.exceeded("eih", NS_PER_S + 2 * FRAME_NS, 7000, NS_PER_S + FRAME_NS)
    assert bound.admits_retransmission(1200)
