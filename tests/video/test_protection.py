"""Which view gets parity, and how much, for which loss."""

from __future__ import annotations

from random import Random

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.config import Network, RepairConfig
from tams_app.records import PacketArrival, Reception, UplinkReport
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.link import loss_model
from tams_app.video.core.protection import Loss, LossEstimate, Protection, share_incomplete
from tams_app.video.core.repair import repair_rule

pytestmark = pytest.mark.untimed

S3 = Network(latency_ms=80, jitter_ms=15, loss=0.01)
MOVING, STILL = 0.1, 0.0


def protection(network: Network = S3, always: bool = False) -> Protection:
    rule = repair_rule(network, 300.0, RepairConfig(mode="adaptive"))
    return Protection(("eih", "gt"), network, rule, 30, always)


def report(*lost: bool, view: str = "eih") -> UplinkReport:
    arrivals = [PacketArrival(view, n, 1200, None if each else n) for n, each in enumerate(lost)]
    return UplinkReport(0, 0, tuple(arrivals))


def test_the_view_that_moves_and_has_the_bits_is_protected_first() -> None:
    assert protection().groups("eih", 0.5, 4.0, MOVING) > 0
    assert protection().groups("gt", 0.1, 2.0, STILL) == 0
    assert protection().groups("eih", 0.02, 4.0, MOVING) == 0


def test_without_loss_nothing_is_protected_and_with_it_more_is() -> None:
    chosen = protection(Network(latency_ms=80))
    assert chosen.groups("eih", 0.5, 4.0, MOVING) == 0
    chosen.observe(report(*([False] * 49 + [True]) * 40))
    assert chosen.groups("eih", 0.5, 4.0, MOVING) > 0
    assert chosen.groups("gt", 0.5, 4.0, MOVING) == 0  # nothing of it was lost


def test_protection_ends_where_nothing_is_lost_any_more() -> None:
    chosen = protection()
    assert chosen.groups("eih", 0.5, 4.0, MOVING) == 1
    chosen.observe(report(*[False] * 20_000))
    assert chosen.groups("eih", 0.5, 3.0, MOVING) == 0


def real() -> Protection:
    assumed = Network(latency_ms=20, jitter_ms=5)
    rule = repair_rule(assumed, 300.0, RepairConfig(mode="adaptive"), real=True)
    return Protection(("eih",), assumed, rule, 10, always=False, real=True)


def far_report(round_trip_ms: float, *lost: bool) -> UplinkReport:
    now_ns = 60 * NS_PER_S
    sent_ns = now_ns - round(round_trip_ms * NS_PER_MS)
    arrivals = tuple(
        PacketArrival("eih", sent_ns - n, 1200, None if each else sent_ns)
        for n, each in enumerate(lost)
    )
    return UplinkReport(now_ns, 0, arrivals)


@pytest.mark.parametrize(("round_trip_ms", "protected"), [(50, False), (58, False), (400, True)])
def test_on_a_real_network_the_measured_round_trip_decides_whether_parity_is_needed(
    round_trip_ms: float, protected: bool
) -> None:
    chosen = real()
    chosen.observe(far_report(round_trip_ms, *([False] * 999 + [True]) * 4))  # .1 % of loss
    assert (chosen.groups("eih", 0.5, 20.0, MOVING) > 0) == protected


def test_one_slow_round_trip_makes_no_link_far_and_a_longer_or_shorter_route_is_followed() -> None:
    chosen = real()
    chosen.observe(far_report(45, *([False] * 999 + [True]) * 4))
    chosen.observe(far_report(400, False))
    assert chosen.groups("eih", 0.5, 20.0, MOVING) == 0
    for _ in range(100):  # five seconds
        chosen.observe(far_report(400, False))
    assert chosen.groups("eih", 0.5, 20.0, MOVING) > 0
    chosen.observe(far_report(45, False))
    assert chosen.groups("eih", 0.5, 20.0, MOVING) == 0


def test_bursts_ask_for_more_parity_than_single_losses() -> None:
    independent = protection(Network(latency_ms=80, loss=0.05))
    bursts = protection(Network(latency_ms=80, loss=0.05, loss_burst=2.5))
    single = independent.groups("eih", 0.5, 12.0, MOVING)
    assert single >= 1
    assert bursts.groups("eih", 0.5, 12.0, MOVING) >= 2


def test_a_choice_is_kept_until_another_one_is_worth_it() -> None:
    chosen = protection()
    share = 0.5
    while protection().groups("eih", share, 4.0, MOVING) != 0:
        share *= 0.9  # the least share at which it is not yet worth to begin
    assert chosen.groups("eih", 0.5, 4.0, MOVING) == 1
    assert chosen.groups("eih", share, 3.0, MOVING) == 1


def test_every_view_is_protected_where_that_is_asked_for() -> None:
    assert protection(Network(latency_ms=80), always=True).groups("gt", 0.0, 1.0, STILL) == 1


def test_report_blocks_tell_the_rate_where_no_arrivals_come() -> None:
    chosen = protection(Network(latency_ms=80))
    blocks = (Reception("eih", 0.03, None, 0),)
    for _ in range(100):
        chosen.observe(UplinkReport(0, 0, receptions=blocks))
    assert chosen.groups("eih", 0.5, 4.0, MOVING) > 0


@pytest.mark.parametrize("burst", [1.0, 3.0])
def test_loss_is_learnt_from_arrivals_whatever_the_network_was_said_to_be(burst: float) -> None:
    estimate = LossEstimate(Loss.of(0.2, 8.0))
    model = loss_model(0.02, burst, Random(4))
    for _ in range(20_000):
        estimate.arrival(model.lost())
    assert estimate.loss.rate == pytest.approx(0.02, rel=0.5)
    assert estimate.loss.mean_burst == pytest.approx(burst, rel=0.4)


def test_an_overflow_does_not_hide_single_losses_from_parity() -> None:
    estimate = LossEstimate(Loss.of(0.0, 1.0))
    for lost in [True] * 80 + ([False] * 249 + [True]) * 4:
        estimate.arrival(lost)
    assert estimate.loss.mean_burst > 10
    alone, protected = (share_incomplete(20.0, groups, estimate.loss) for groups in (0, 1))
    assert protected < 0.4 * alone


@pytest.mark.parametrize(("rate", "burst"), [(0.01, 1.0), (0.03, 2.0)])
@pytest.mark.parametrize("groups", [0, 1, 2])
def test_the_share_of_incomplete_frames_is_that_of_the_loss_model(
    rate: float, burst: float, groups: int
) -> None:
    packets, frames, model, incomplete = 6, 40_000, loss_model(rate, burst, Random(5)), 0
    for _ in range(frames):
        lost = [model.lost() for _ in range(packets + groups)]
        if groups:
            incomplete += any(
                sum(lost[group::groups]) > 1 and any(lost[:packets][group::groups])
                for group in range(groups)
            )
        else:
            incomplete += any(lost)
    expected = share_incomplete(packets, groups, Loss.of(rate, burst))
    assert incomplete / frames == pytest.approx(expected, rel=0.45)


@given(
    st.floats(0, 1),
    st.floats(1, 20),
    st.floats(0, 1),
    st.floats(0.1, 60),
    st.floats(0, 1),
)
def test_any_loss_has_an_answer(
    rate: float, burst: float, share: float, packets: float, changed: float
) -> None:
    network = Network(latency_ms=80, loss=rate, loss_burst=burst if rate < 0.5 else 1.0)
    chosen = protection(network).groups("eih", share, packets, changed)
    assert 0 <= chosen <= max(1, packets / 2)
