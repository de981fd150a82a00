"""The repair rules per network, and the rationing of keyframe requests."""

from __future__ import annotations

from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.config import Network, RepairConfig, load_config
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.receiver import KeyframeRequests
from tams_app.video.core.repair import RepairRule, repair_rule

pytestmark = pytest.mark.untimed


@pytest.mark.parametrize(
    ("network", "rule"),
    [
        (Network(latency_ms=15, jitter_ms=2), RepairRule(True, 60, 300.0)),
        (Network(latency_ms=40, jitter_ms=8), RepairRule(True, 132, 300.0)),
        (Network(latency_ms=80, jitter_ms=15), RepairRule(False, 50, 300.0)),
        (Network(latency_ms=200, jitter_ms=0), RepairRule(False, 20, 400.0)),
        (Network(latency_ms=75, jitter_ms=0), RepairRule(True, 200, 300.0)),
    ],
)
def test_the_paper_networks_get_their_rule(network: Network, rule: RepairRule) -> None:
    assert repair_rule(network, 300.0) == rule


@pytest.mark.parametrize(
    ("latency_ms", "wanted", "rule"),
    [
        (40, RepairConfig(mode="paper", rtx="off"), RepairRule(False, 36, 300.0)),
        (80, RepairConfig(mode="paper", rtx="on"), RepairRule(True, 228, 300.0)),
        (40, RepairConfig(mode="paper", pli=False), RepairRule(True, 132, 300.0, pli=False)),
    ],
)
def test_repair_can_be_switched_whatever_the_rule_says(
    latency_ms: float, wanted: RepairConfig, rule: RepairRule
) -> None:
    assert repair_rule(Network(latency_ms=latency_ms, jitter_ms=8), 300.0, wanted) == rule


@pytest.mark.parametrize(
    ("rate_hz", "with_rtx_ms", "without_ms"), [(60, 132, 50), (30, 132, 50), (5, 298, 50)]
)
def test_where_frames_are_rare_a_resend_is_waited_for_longer(
    rate_hz: int, with_rtx_ms: int, without_ms: int
) -> None:
    usual_ns = NS_PER_S // rate_hz
    assert RepairRule(True, 132, 300.0).wait_ms(usual_ns) == with_rtx_ms
    assert RepairRule(False, 50, 300.0).wait_ms(usual_ns) == without_ms


@given(st.floats(0, 500), st.floats(0, 100))
def test_the_jitter_buffer_never_waits_longer_than_repair_is_worth(
    latency_ms: float, jitter_ms: float
) -> None:
    rule = repair_rule(Network(latency_ms=latency_ms, jitter_ms=jitter_ms), 300.0)
    assert rule.latency_ms >= 2 * jitter_ms + 20
    assert not rule.rtx or 1.2 * 2 * latency_ms <= rule.latency_ms <= 200


ADAPTIVE = RepairConfig(mode="adaptive")


@pytest.mark.parametrize(
    ("latency_ms", "jitter_ms", "rtx", "parity", "wait_ms"),
    [
        (15, 2, True, False, 60),
        (40, 8, True, False, 132),
        (50, 10, True, True, 140),  # the best resends come in time: those are waited for
        (60, 10, False, True, 40),
        (80, 15, False, True, 50),
    ],
)
def test_adaptive_repair_resends_what_comes_in_time_and_protects_the_rest(
    latency_ms: float, jitter_ms: float, rtx: bool, parity: bool, wait_ms: int
) -> None:
    network = Network(latency_ms=latency_ms, jitter_ms=jitter_ms)
    rule = repair_rule(network, 300.0, ADAPTIVE)
    assert (rule.rtx, rule.parity, rule.latency_ms) == (rtx, parity, wait_ms)


@given(st.floats(0, 500), st.floats(0, 100), st.floats(20, 2000), st.integers(1, 60))
def test_adaptive_repair_waits_for_no_resend_beyond_the_bound(
    latency_ms: float, jitter_ms: float, bound_ms: float, rate_hz: int
) -> None:
    network = Network(latency_ms=latency_ms, jitter_ms=jitter_ms)
    rule = repair_rule(network, 300.0, ADAPTIVE, bound_ms)
    wait_ms = rule.wait_ms(NS_PER_S // rate_hz)
    for_jitter_ms = 2 * jitter_ms + 20
    assert wait_ms <= max(bound_ms - latency_ms - jitter_ms, for_jitter_ms) + 1


@pytest.mark.parametrize(
    ("network", "paper_ms", "adaptive_ms"), [("s1", 300, 300), ("s2", 300, 300), ("s3", 300, 420)]
)
def test_adaptive_repair_repeats_no_request_so_soon_that_the_sender_ignores_it(
    network: str, paper_ms: float, adaptive_ms: float
) -> None:
    """rtpsession obeys none that follows another by less than two round trips, as it measures."""
    found = load_config().networks[network]
    assert repair_rule(found, 300.0).pli_interval_ms == paper_ms
    assert repair_rule(found, 300.0, ADAPTIVE).pli_interval_ms == adaptive_ms
    longest_round_trip_ms = 2 * found.latency_ms + found.jitter_ms
    assert adaptive_ms >= 2 * longest_round_trip_ms + found.jitter_ms


def test_parity_can_be_switched_on_and_off_and_the_paper_has_none() -> None:
    near, far = Network(latency_ms=15), Network(latency_ms=80)
    assert repair_rule(near, 300.0, RepairConfig(mode="adaptive", parity="on")).parity
    assert not repair_rule(far, 300.0, RepairConfig(mode="adaptive", parity="off")).parity
    assert not repair_rule(far, 300.0, RepairConfig(mode="paper", parity="on")).parity


def test_the_first_loss_asks_at_once_and_the_next_waits_its_turn() -> None:
    requests = KeyframeRequests(300.0)
    assert requests.request(0)
    assert not requests.request(100 * NS_PER_MS)
    assert not requests.due(299 * NS_PER_MS)
    assert requests.due(300 * NS_PER_MS)
    assert not requests.due(700 * NS_PER_MS)


def test_a_request_that_was_lost_itself_is_repeated_until_a_keyframe_comes() -> None:
    requests = KeyframeRequests(300.0)
    assert requests.request(0)
    assert not requests.due(599 * NS_PER_MS)
    assert requests.due(600 * NS_PER_MS)
    assert requests.due(1200 * NS_PER_MS)
    requests.chain(unbroken=True)
    assert not requests.due(5000 * NS_PER_MS)


@pytest.mark.parametrize("complete", [True, False])
def test_a_complete_keyframe_answers_a_waiting_request_and_no_other(complete: bool) -> None:
    requests = KeyframeRequests(300.0)
    requests.request(0)
    requests.request(50 * NS_PER_MS)
    requests.chain(unbroken=complete)
    assert requests.due(400 * NS_PER_MS) != complete


def test_a_broken_chain_is_asked_for_also_where_no_gap_was_seen() -> None:
    requests = KeyframeRequests(300.0)
    requests.chain(unbroken=True)
    assert not requests.due(0)
    requests.chain(unbroken=False)
    assert requests.due(100 * NS_PER_MS)


@given(st.lists(st.tuples(st.integers(0, 100), st.booleans()), max_size=200))
def test_there_is_never_more_than_one_request_per_interval(steps: list[tuple[int, bool]]) -> None:
    requests = KeyframeRequests(300.0)
    now_ms, sent_ms = 0, []
    for wait_ms, lost in steps:
        now_ms += wait_ms
        asked = requests.request if lost else requests.due
        if asked(now_ms * NS_PER_MS):
            sent_ms.append(now_ms)
    assert all(later - earlier >= 300 for earlier, later in pairwise(sent_ms))


@given(st.lists(st.integers(0, 500), min_size=1, max_size=50))
def test_no_loss_goes_unanswered(losses_ms: list[int]) -> None:
    requests = KeyframeRequests(300.0)
    answers = []
    for loss_ms in sorted(losses_ms):
        if requests.request(loss_ms * NS_PER_MS):
            answers.append(loss_ms)
    if requests.due(2000 * NS_PER_MS):
        answers.append(2000)
    assert answers[-1] >= max(losses_ms)
