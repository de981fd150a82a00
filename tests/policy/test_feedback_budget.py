"""The capacity from per-packet feedback."""

import math
from collections.abc import Iterator
from dataclasses import replace
from itertools import pairwise
from random import Random

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tams_app.capacity import UnlimitedCapacity
from tams_app.config import BudgetConfig, load_config
from tams_app.policy.budget.feedback import FeedbackBudget
from tams_app.policy.budget.queueing_delay import QueueingDelay
from tams_app.records import PacketArrival, UplinkReport
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.policy.uplink_model import Uplink

pytestmark = pytest.mark.untimed

POLICY = load_config().policy
FLOORS_KBPS = 450.0
START_KBPS = FLOORS_KBPS / 0.92
RUNS = settings(max_examples=10, deadline=None)


def fresh(**keys: float) -> FeedbackBudget:
    budget = BudgetConfig(mode="feedback", **keys)
    return FeedbackBudget(POLICY.model_copy(update={"budget": budget}), UnlimitedCapacity())


def estimates(uplink: Uplink, seconds: float, **keys: float) -> list[float]:
    return [kbps for _, kbps in uplink.run(fresh(**keys), seconds)]


def between(uplink: Uplink, start_s: float, end_s: float) -> list[float]:
    return [kbps for t_s, kbps in uplink.run(fresh(), end_s) if t_s >= start_s]


def mean(uplink: Uplink, start_s: float, end_s: float) -> float:
    found = between(uplink, start_s, end_s)
    return sum(found) / len(found)


def steady(kbps: float) -> Uplink:
    return Uplink(lambda _t: kbps)


def outage(kbps: float, start_s: float, end_s: float) -> Uplink:
    return Uplink(lambda t_s: 0.0 if start_s <= t_s < end_s else kbps)


packets = st.builds(
    PacketArrival,
    st.sampled_from(("eih", "gt", "gs")),
    st.integers(0, 5 * NS_PER_S),
    st.integers(1, 1500),
    st.none() | st.integers(-NS_PER_S, 20 * NS_PER_S),
)


@given(
    st.lists(st.tuples(st.integers(0, NS_PER_S), st.integers(0, 10**7), st.lists(packets))),
    st.floats(1, 1e5),
    st.floats(5, 150),
)
def test_the_estimate_is_finite_and_between_nothing_and_the_maximum(told, max_kbps, target_ms):
    budget = fresh(max_kbps=max_kbps, delay_target_ms=target_ms)
    now_ns, sent_bytes = 0, 0
    for elapsed_ns, size_bytes, arrivals in told:
        now_ns, sent_bytes = now_ns + elapsed_ns, sent_bytes + size_bytes
        budget.observe(UplinkReport(now_ns, sent_bytes, tuple(arrivals)))
        assert 0 <= budget.capacity_kbps(now_ns) <= max_kbps
        assert 0 < budget.flight_limit_bytes(now_ns) < math.inf
        assert 0 <= budget.padding_bytes(now_ns) <= max_kbps * 50 / 8 + 1


def test_a_link_that_carries_more_than_the_maximum_is_used_up_to_the_maximum():
    assert max(estimates(steady(30_000), 5, max_kbps=5000)) == 5000


@pytest.mark.parametrize(("kbps", "seconds"), [(3000, 1.05), (6000, 1.05), (12_000, 1.35)])
def test_it_starts_at_the_floors_and_is_soon_at_what_the_link_carries(kbps, seconds):
    first, *others = estimates(steady(kbps), seconds)
    assert first == pytest.approx(START_KBPS)
    assert max(others) > 0.8 * kbps


@RUNS
@given(st.sampled_from((3000, 6000, 12_000)), st.sampled_from((0, 8)), st.integers(0, 99))
def test_on_a_steady_link_it_stays_near_what_the_link_carries(kbps, jitter_ms, seed):
    uplink = replace(steady(kbps), jitter_ms=jitter_ms, random=Random(seed))
    assert 0.9 * kbps < mean(uplink, 5, 20) < 1.05 * kbps


@pytest.mark.verify
@RUNS
@given(st.integers(-(10**15), 10**15))
def test_the_offset_of_the_receivers_clock_changes_nothing(offset_ns):
    offset_ns = offset_ns // 250_000 * 250_000
    away = replace(steady(6000), clock_offset_ns=offset_ns, jitter_ms=8, random=Random(1))
    here = replace(steady(6000), jitter_ms=8, random=Random(1))
    assert estimates(away, 5) == estimates(here, 5)


@pytest.mark.verify
@RUNS
@given(st.integers(0, 10**6))
def test_how_arrivals_are_split_into_reports_of_one_instant_changes_nothing(seed):
    random = Random(seed)

    def split(report):
        cut = random.randint(0, len(report.arrivals))
        parts = report.arrivals[:cut], report.arrivals[cut:]
        return [replace(report, arrivals=part) for part in parts]

    assert estimates(replace(steady(6000), reports=split), 6) == estimates(steady(6000), 6)


@pytest.mark.verify
@RUNS
@given(st.integers(1, 60), st.integers(1, 5))
def test_what_is_told_again_changes_nothing(later, times):
    told: list[tuple[PacketArrival, ...]] = []

    def again(report):
        told.append(report.arrivals)
        old = told[-1 - later] if len(told) > later else ()
        return [report, *[replace(report, arrivals=old)] * times]

    assert estimates(replace(steady(6000), reports=again), 6) == estimates(steady(6000), 6)


@pytest.mark.parametrize(("delay_ms", "jitter_ms"), [(40, 30), (100, 25), (200, 30)])
def test_jitter_is_not_taken_for_a_queue(delay_ms, jitter_ms):
    for seed in range(3):
        far = replace(
            steady(6000), delay_ms=lambda _t: delay_ms, jitter_ms=jitter_ms, random=Random(seed)
        )
        assert 0.8 * 6000 < mean(far, 10, 40) < 1.1 * 6000


@pytest.mark.parametrize(("delay_ms", "jitter_ms", "within_s"), [(100, 50, 5), (200, 60, 10)])
def test_jitter_does_not_end_the_start(delay_ms, jitter_ms, within_s):
    for seed in range(8):
        far = replace(
            steady(6000), delay_ms=lambda _t: delay_ms, jitter_ms=jitter_ms, random=Random(seed)
        )
        assert max(estimates(far, within_s)) > 0.7 * 6000


@pytest.mark.parametrize("kbps", [3000, 4000, 5000, 6000, 8000])
def test_a_start_over_a_far_link_does_not_double_beyond_what_it_carries(kbps):
    far = replace(steady(kbps), delay_ms=lambda _t: 200)
    assert max(estimates(far, 15)) < 1.45 * kbps


@pytest.mark.parametrize("frame_steps", [1, 2, 4])
def test_rare_frames_that_leave_at_once_are_not_taken_for_more_than_the_link_carries(frame_steps):
    rare = replace(steady(6000), frame_steps=frame_steps, jitter_ms=8, queue_ms=400)
    assert 0.8 * 6000 < mean(rare, 10, 60) < 1.05 * 6000


@pytest.mark.parametrize("kbps", [350, 200, 100])
def test_a_link_that_carries_less_than_the_floors_is_found_too(kbps):
    assert 0.75 * kbps < mean(steady(kbps), 10, 40) < 1.1 * kbps


def test_a_narrow_link_is_never_tried_with_more_than_the_floors():
    """The first frames arrive further apart than they were sent, which says what it carries."""
    assert max(estimates(steady(100), 4)) == pytest.approx(START_KBPS)


def test_beside_a_flow_that_fills_the_queue_it_keeps_a_share_and_has_the_link_again_after_it():
    def delay_ms(t_s: float) -> float:
        return 40 + (40 + 30 * math.sin(4 * t_s) if 10 < t_s < 30 else 0)

    uplink = replace(steady(6000), delay_ms=delay_ms)
    estimate = list(uplink.run(fresh(), 36))
    beside = [kbps for t_s, kbps in estimate if 12 <= t_s < 30]
    after = [kbps for t_s, kbps in estimate if t_s >= 34]
    assert sum(beside) / len(beside) > 0.3 * 6000
    assert sum(after) / len(after) > 0.9 * 6000


def test_a_longer_route_that_seemed_another_flow_is_known_for_one_in_the_end():
    def delay_ms(t_s: float) -> float:
        return 40 + (50 + (20 * math.sin(6 * t_s) if t_s < 14 else 0) if t_s > 10 else 0)

    settled = between(replace(steady(6000), delay_ms=delay_ms), 36, 50)
    assert sum(settled) / len(settled) > 0.95 * 6000
    assert max(settled) < 1.1 * 6000


def test_a_longer_queue_that_is_not_ours_lowers_what_is_allowed_further():
    def lowest(added_ms: float) -> float:
        grown = replace(steady(6000), delay_ms=lambda t: 40 + added_ms * (t > 5))
        return min(between(grown, 5, 6))

    unmoved, short, longer, long = map(lowest, (0, 20, 50, 160))
    assert unmoved > short > longer > long
    assert long < 0.4 * 6000


def test_a_queue_beyond_the_target_cuts_below_what_is_delivered():
    before, *_, after = between(Uplink(lambda t: 12_000 if t < 10 else 3000), 9.9, 10.4)
    assert before > 10_000
    assert after < 3000


@pytest.mark.verify
@RUNS
@given(st.floats(0, 0.015), st.integers(0, 99))
def test_independent_loss_below_two_per_cent_does_not_cut(share, seed):
    lossy = replace(steady(6000), lost=lambda r: r.random() < share, random=Random(seed))
    assert mean(lossy, 5, 15) > 0.95 * 6000


def test_silence_lets_a_trickle_through_whatever_the_floors_are():
    silent = between(outage(6000, 5, 60), 5, 7)
    assert silent[0] > 5000
    assert 0 < silent[-1] < START_KBPS / 4
    assert all(later <= earlier for earlier, later in pairwise(silent[8:]))


@pytest.mark.parametrize("outage_s", [0.3, 1.0, 3.0])
def test_the_return_of_feedback_recovers_within_a_second(outage_s):
    back_s = 5 + outage_s + 0.15  # the first packet and its way back
    estimate = between(outage(6000, 5, 5 + outage_s), back_s, back_s + 1.05)
    assert max(estimate) > 0.8 * 6000


def test_what_an_outage_has_held_up_says_nothing_of_the_link():
    def delay_ms(t_s: float) -> float:
        return 40 + (1000 * (6 - t_s) if 5 <= t_s < 6 else 0)  # all arrives at once

    first = between(replace(steady(6000), delay_ms=delay_ms), 6.1, 6.3)
    assert max(first) < 0.8 * 6000


def test_an_outage_takes_half_of_what_may_be_under_way_in_a_second():
    budget = fresh()
    limits = [budget.flight_limit_bytes(0) for _ in outage(12_000, 5, 60).run(budget, 10)]
    assert limits[-1] == pytest.approx(limits[-21] / 2, rel=0.05)


def test_silence_after_everything_was_told_of_means_nothing():
    nothing = replace(steady(6000), share=lambda t: 1.0 if t < 5 else 0.0)
    before, *after = between(nothing, 5, 20)
    assert min(after) >= 0.95 * before


@RUNS
@given(st.floats(0.02, 0.5))
def test_views_that_send_less_than_they_may_do_not_lower_it(share):
    limited = replace(steady(6000), share=lambda t: share if t > 5 else 1.0)
    assert mean(limited, 5, 15) >= 0.95 * 6000


@pytest.mark.verify
@pytest.mark.parametrize("kbps", [3000, 6000, 12_000])
@pytest.mark.parametrize("share", [0.74, 0.8, 0.9])
def test_encoders_that_stay_below_their_targets_do_not_pull_it_down(kbps, share):
    for seed in range(3):
        below = replace(
            steady(kbps), share=lambda _t: share, jitter_ms=8, random=Random(f"{seed}/below")
        )
        assert 0.88 * kbps < mean(below, 10, 40) < 1.05 * kbps


@pytest.mark.parametrize("drift", [-1e-4, 1e-4])
def test_a_slowly_drifting_clock_does_not_matter(drift):
    drifting = replace(steady(6000), clock_drift=drift)
    assert min(between(drifting, 5, 30)) > 0.85 * 6000


@pytest.mark.parametrize("jump_s", [-(2**24) * 0.064, -3, 3, 2**24 * 0.064])
def test_a_receivers_clock_that_jumps_is_survived(jump_s):
    jumps = replace(steady(6000), clock_jump_ns=lambda t: round(jump_s * NS_PER_S) * (t > 8))
    assert min(between(jumps, 10, 20)) > 0.8 * 6000


@pytest.mark.parametrize("change_ms", [-20, 20, 60])
def test_a_route_that_changes_its_length_is_survived(change_ms):
    changed = replace(steady(6000), delay_ms=lambda t: 40 + change_ms * (t > 8))
    assert min(between(changed, 14, 20)) > 0.8 * 6000


@RUNS
@given(st.integers(0, 99))
def test_lost_feedback_is_not_taken_for_a_slower_link(seed):
    random = Random(seed)

    def some(report):
        return [replace(report, arrivals=() if random.random() < 0.05 else report.arrivals)]

    # the worst of all 100 seeds: .83
    assert mean(replace(steady(6000), reports=some), 5, 15) > 0.8 * 6000


def test_a_packet_told_lost_that_arrives_after_all_is_no_harm():
    def first_lost(report):
        lost = tuple(replace(one, arrived_ns=None) for one in report.arrivals[:1])
        return [replace(report, arrivals=lost), report]

    def at_times(report):
        return first_lost(report) if report.now_ns % NS_PER_S == 0 else [report]

    once = replace(steady(6000), reports=at_times)
    assert min(between(once, 5, 10)) > 0.85 * 6000


def padding_after(uplink: Uplink, start_s: float, end_s: float, **keys: float) -> int:
    budget = fresh(**keys)
    asked: list[int] = []
    pad = budget.padding_bytes

    def counted(now_ns: int) -> int:
        padding = pad(now_ns)
        if now_ns >= (1 + start_s) * NS_PER_S:
            asked.append(padding)
        return padding

    budget.padding_bytes = counted
    for _ in uplink.run(budget, end_s):
        pass
    return sum(asked)


def test_nothing_is_padded_where_there_is_nothing_to_find_out():
    assert padding_after(steady(6000), 5, 10) > 0
    at_most = padding_after(steady(30_000), 5, 10, max_kbps=5000)
    assert at_most < 0.01 * 5000 / 8 * 5000  # of what is sent in 5 s
    limited = replace(steady(6000), share=lambda t: 0.3 if t > 5 else 1.0)
    assert padding_after(limited, 7, 12) == 0


def test_padding_is_asked_for_once():
    budget = fresh()
    asked = 0
    for t_s, _ in steady(6000).run(budget, 1):
        now_ns = NS_PER_S + round(t_s * NS_PER_S) + 49 * NS_PER_MS
        asked += budget.padding_bytes(now_ns)
        assert budget.padding_bytes(now_ns) == 0
    assert asked > 0


def test_what_a_steady_link_has_under_way_is_below_the_limit():
    budget = fresh()
    for _ in steady(6000).run(budget, 10):
        pass
    assert budget.flight_limit_bytes(11 * NS_PER_S) > 0.92 * 6000 / 8 * (40 + 60 + 50)


# --- a queue told from jitter, by delays on two clocks -------------------------------------------

BURST_NS, STEP_NS = 11 * NS_PER_MS, 50 * NS_PER_MS


def steps(jitter_ms: float, seed: int, queue_from_s: float = 1e9) -> Iterator[QueueingDelay]:
    """After each policy step of a minute, where order is kept; a queue of 60 ms from then."""
    delay, random = QueueingDelay(), Random(seed)
    delivered_ns, next_ns = 0, STEP_NS
    for sent_ns in range(0, 60 * NS_PER_S, BURST_NS):
        way_ms = 400 + random.uniform(-jitter_ms, jitter_ms)
        way_ms += 60 if sent_ns >= queue_from_s * NS_PER_S else 0
        delivered_ns = max(delivered_ns, sent_ns + round(way_ms * NS_PER_MS))
        delay.add(sent_ns, delivered_ns)
        if sent_ns >= next_ns:
            next_ns += STEP_NS
            delay.step(sent_ns, 3000.0)
            yield delay


@pytest.mark.parametrize("jitter_ms", [0, 8, 25, 50])
def test_jitter_seldom_looks_like_a_queue(jitter_ms: float) -> None:
    for seed in range(3):
        found = [d.queue_ns > 1.5 * max(d.spread_ns, 4 * NS_PER_MS) for d in steps(jitter_ms, seed)]
        assert sum(found[200:]) < 0.04 * len(found[200:])


@pytest.mark.parametrize("jitter_ms", [0, 8, 25])
def test_a_queue_is_seen_within_half_a_second(jitter_ms: float) -> None:
    found = [delay.queue_ns for delay in steps(jitter_ms, 1, queue_from_s=30)]
    at = round(30 * NS_PER_S / STEP_NS)
    assert max(found[at - 20 : at - 1]) < 40 * NS_PER_MS
    assert found[at + 10] > 40 * NS_PER_MS
