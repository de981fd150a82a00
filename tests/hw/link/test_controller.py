"""A hand at another computer: what is old, forged or out of order never moves the arm."""

from __future__ import annotations

import math
from bisect import bisect_right
from collections.abc import Callable
from functools import partial
from itertools import groupby, pairwise

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydantic import ValidationError

from hw.link.controller import LinkController
from tams_app.config import LinkConfig
from tams_app.link.quic import OVERHEAD_BYTES
from tams_app.records import ControllerSample, ControllerStatus, Haptic, Presses
from tams_app.session.robot import for_robot
from tams_app.teleop.safety import ArmingState, Reason
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.hw.link.exchange import HOUR_NS, TICK_NS, Exchange, hand_message, queued
from tests.teleop.rig import Bench, hand_for, make_config

pytestmark = pytest.mark.untimed

OK, LOST = ControllerStatus.OK, ControllerStatus.LINK_LOST
GAP, LEFT = ControllerStatus.LINK_GAP, ControllerStatus.OPERATOR_AWAY
DELAY_NS = 20 * NS_PER_MS
REST_NS = 100 * NS_PER_MS  # in which a hold comes to rest
JUMPS_NS = st.integers(0, HOUR_NS) | st.integers(-HOUR_NS, -150 * NS_PER_MS)


@pytest.fixture
def exchange() -> Exchange:
    return Exchange().settled()


def new_poses(samples: list[ControllerSample], since_ns: int) -> list[ControllerSample]:
    """Samples that could move the arm by a pose that is newer than `since_ns`."""
    return [s for s in samples if s.status is OK and s.pose is not None and s.pose_ns > since_ns]


# --- samples --------------------------------------------------------------------------------------


def test_samples_come_with_the_hands_pose_and_buttons(exchange: Exchange) -> None:
    exchange.hand.velocity = np.array([0.2, 0.0, 0.0])
    exchange.hand.trigger = 0.75
    samples = exchange.run_ms(500)
    assert {sample.status for sample in samples} == {OK}
    assert samples[-1].trigger == 0.75
    for before, after in pairwise(samples[5:]):
        assert before.pose is not None
        assert after.pose is not None
        moved_m = np.linalg.norm(after.pose.position - before.pose.position)
        assert moved_m == pytest.approx(0.2 * (after.pose_ns - before.pose_ns) / NS_PER_S, rel=1e-6)


@settings(max_examples=40)
@given(
    offset_ns=st.integers(-90 * HOUR_NS, 1000 * HOUR_NS),
    delays_ms=st.lists(st.none() | st.integers(0, 60), min_size=20, max_size=60),
)
def test_times_never_go_back_and_are_newer_than_the_hand_by_no_more_than_a_way_shortens_unseen(
    offset_ns: int, delays_ms: list[int | None]
) -> None:
    exchange = Exchange(offset_ns=offset_ns)
    ways = iter(delays_ms)

    def delay(_: int) -> int | None:
        delay_ms = next(ways, 20)
        return None if delay_ms is None else delay_ms * NS_PER_MS

    exchange.up = delay
    pose_ns = buttons_ns = 0
    for _ in range(len(delays_ms) + 10):
        sample = exchange.tick()
        if sample.status in (LOST, GAP):
            pose_ns = buttons_ns = 0
            continue
        newest_ns = exchange.now_ns + exchange.config.jitter_ms * NS_PER_MS
        assert pose_ns <= sample.pose_ns <= newest_ns
        assert buttons_ns <= sample.buttons_ns <= newest_ns
        pose_ns, buttons_ns = sample.pose_ns, sample.buttons_ns


def test_times_do_not_go_back_when_the_way_becomes_shorter(exchange: Exchange) -> None:
    """A pose that waited at its own side for longer, behind one that waited on the way."""
    exchange.run_ms(11_000)
    exchange.controller.let_go()
    assert exchange.controller.sample(exchange.now_ns).status is ControllerStatus.LINK_LOST
    sent_ns = exchange.now_ns + exchange.offset_ns
    echo_ns = exchange.now_ns - 40 * NS_PER_MS
    earlier = exchange.message(echo_ns=echo_ns)
    later = exchange.message(
        sent_ns=sent_ns + 8 * NS_PER_MS,
        pose_ns=earlier.pose_ns + 1,
        buttons_ns=earlier.buttons_ns + 1,
        echo_ns=echo_ns,
    )
    exchange.now_ns += 30 * NS_PER_MS
    assert exchange.take(earlier) == ""
    before = exchange.controller.sample(exchange.now_ns)
    exchange.now_ns += NS_PER_MS
    assert exchange.take(later) == ""
    after = exchange.controller.sample(exchange.now_ns)
    assert (after.pose_ns, after.buttons_ns) == (before.pose_ns, before.buttons_ns)


def test_a_pose_that_does_not_change_grows_old(exchange: Exchange) -> None:
    exchange.hand.frozen = True
    exchange.run_ms(100)
    first = exchange.tick()
    exchange.up = lambda now_ns: DELAY_NS + now_ns % (15 * NS_PER_MS)
    for sample in exchange.run_ms(30_000):  # longer than what the offset is taken from
        assert (sample.status, sample.pose_ns) == (OK, first.pose_ns)
        assert sample.pose is first.pose
        assert sample.buttons_ns > sample.pose_ns


@pytest.mark.parametrize("status", [status for status in ControllerStatus if status is not OK])
@pytest.mark.parametrize("count", [0, 3], ids=["steady", "too many gaps"])
def test_every_status_of_the_hand_is_passed_on(
    exchange: Exchange, status: ControllerStatus, count: int
) -> None:
    gaps(exchange, count, 75, 150)
    exchange.hand.status = status
    assert exchange.run_ms(100)[-1].status is status


def test_buttons_that_do_not_change_grow_old_though_the_way_becomes_longer(
    exchange: Exchange,
) -> None:
    exchange.hand.buttons_frozen = True
    exchange.run_ms(100)
    first = exchange.tick()
    exchange.up = lambda _: DELAY_NS + 30 * NS_PER_MS
    for sample in exchange.run_ms(1000):
        assert (sample.status, sample.buttons_ns) == (OK, first.buttons_ns)
    assert sample.pose_ns > first.pose_ns


def test_every_press_is_passed_on(exchange: Exchange) -> None:
    assert exchange.take(exchange.message(presses=(1, 2, 3, 4))) == ""
    presses = exchange.controller.sample(exchange.now_ns).presses
    assert presses == Presses(grip=1, a=2, b=3, menu=4)


def test_a_pose_that_changes_without_its_time_is_the_new_one_and_no_newer(
    exchange: Exchange,
) -> None:
    made_ns = exchange.now_ns + exchange.offset_ns - 10 * NS_PER_MS
    times_ns = []
    for x in (0.1, 0.2):
        exchange.now_ns += 10 * NS_PER_MS
        sent_ns = exchange.now_ns + exchange.offset_ns - DELAY_NS
        pose = (x, 1.0, -0.3, 0.0, 0.0, 0.0, 1.0)
        message = exchange.message(sent_ns=sent_ns, pose=pose, pose_ns=made_ns, buttons_ns=made_ns)
        assert exchange.take(message) == ""
        sample = exchange.controller.sample(exchange.now_ns)
        assert sample.pose is not None
        assert sample.pose.position.tolist() == [x, 1.0, -0.3]
        times_ns.append(sample.pose_ns)
    assert times_ns[0] == times_ns[1]


@pytest.mark.parametrize("clock_ns", [-7 * HOUR_NS, 200 * HOUR_NS])
def test_a_hand_that_never_had_a_pose_has_no_pose_that_is_new(clock_ns: int) -> None:
    exchange = Exchange(offset_ns=clock_ns)
    exchange.hand.tracked = False
    exchange.hand.status = ControllerStatus.TRACKING_LOST
    sample = exchange.run_ms(500)[-1]
    assert (sample.status, sample.pose) == (ControllerStatus.TRACKING_LOST, None)
    assert sample.pose_ns == max(0, DELAY_NS - clock_ns)


def test_the_time_of_a_pose_that_is_lost_does_not_go_back_when_the_way_becomes_shorter(
    exchange: Exchange,
) -> None:
    exchange.up = lambda _: DELAY_NS + 40 * NS_PER_MS
    exchange.run_ms(500)
    exchange.hand.tracked = False
    exchange.hand.status = ControllerStatus.TRACKING_LOST
    last = exchange.run_ms(100)[-1]
    assert last.pose is None
    exchange.up = lambda _: DELAY_NS
    for sample in exchange.run_ms(500):
        assert sample.pose_ns >= last.pose_ns
        last = sample
    assert (last.status, last.pose) == (ControllerStatus.TRACKING_LOST, None)


def test_while_poses_wait_a_pose_that_is_lost_is_gone_and_one_that_is_found_is_there_at_once(
    exchange: Exchange,
) -> None:
    exchange.up = lambda _: DELAY_NS + 40 * NS_PER_MS
    last = exchange.run_ms(500)[-1]
    exchange.up = lambda _: DELAY_NS
    for _ in range(10):
        before, last = last, exchange.tick()
        if last.pose_ns == before.pose_ns:
            break
    assert last.pose_ns == before.pose_ns, "the poses wait"
    exchange.on_their_way.clear()
    exchange.now_ns += NS_PER_MS
    assert exchange.take(exchange.message(pose=None)) == ""
    assert exchange.controller.sample(exchange.now_ns).pose is None
    exchange.now_ns += NS_PER_MS
    found = exchange.message()
    assert exchange.take(found) == ""
    sample = exchange.controller.sample(exchange.now_ns)
    assert sample.pose is not None
    assert sample.pose_ns > last.pose_ns


def test_what_is_heard_before_the_start_does_not_count() -> None:
    exchange = Exchange()
    controller = LinkController(exchange.config, lambda _: None, exchange.pulses.append)
    now_ns = exchange.now_ns
    message = exchange.message(echo_ns=now_ns - DELAY_NS)
    assert controller.take(message, now_ns) == ""
    assert controller.sample(now_ns).status is ControllerStatus.DISCONNECTED
    controller.start()
    assert controller.sample(now_ns).status is LOST


def test_what_is_heard_before_the_first_sample_counts_in_it() -> None:
    exchange = Exchange()
    assert exchange.take(exchange.message(echo_ns=exchange.now_ns - DELAY_NS)) == ""
    assert exchange.controller.sample(exchange.now_ns).status is OK


def test_pulses_go_out_only_while_it_is_in_use() -> None:
    exchange = Exchange()
    exchange.controller.pulse(Haptic.LIMIT)
    exchange.controller.close()
    exchange.controller.pulse(Haptic.FAULT)
    assert exchange.pulses == [Haptic.LIMIT]


# --- what does not count --------------------------------------------------------------------------


def before(exchange: Exchange, ago_ns: int) -> dict[str, object]:
    """What makes a message one that was sent so long ago."""
    now = exchange.message()
    names = ("sent_ns", "pose_ns", "buttons_ns", "echo_ns", "echo_heard_ns")
    return {name: getattr(now, name) - ago_ns for name in names}


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        (lambda e: {"echo_ns": 0}, "without an echo"),
        (lambda e: {"echo_ns": e.now_ns + 1}, "without an echo"),
        (lambda e: {"echo_ns": e.now_ns + HOUR_NS}, "without an echo"),
        (lambda e: before(e, 300 * NS_PER_MS), "too old"),
        (lambda e: before(e, HOUR_NS), "too old"),
        (lambda e: {"echo_ns": e.now_ns - 1000 * NS_PER_MS - 1}, "unanswered"),
        (lambda e: {"echo_ns": e.now_ns - HOUR_NS}, "unanswered"),
        (lambda e: {"sent_ns": e.sent[-4].sent_ns}, "overtaken"),
        (lambda e: {"sent_ns": e.sent[-10].sent_ns}, "overtaken"),
        (lambda e: {"pose_ns": e.now_ns + e.offset_ns + 1}, "from the future"),
        (lambda e: {"buttons_ns": e.now_ns + e.offset_ns + 1}, "from the future"),
        (lambda e: {"status": "fine"}, "of unknown status"),
        (lambda e: {"pose": (0.0,) * 7}, "without a rotation"),
        (lambda e: {"pose": (0.0, 0.0, 0.0, 0.0, 0.0, 0.0, math.nan)}, "without a rotation"),
        (lambda e: {"pose": (0.0, 0.0, 0.0, 0.0, math.inf, 0.0, 1.0)}, "without a rotation"),
    ],
)
def test_what_does_not_count_changes_nothing_but_its_counter(
    exchange: Exchange, changes: Callable[[Exchange], dict[str, object]], reason: str
) -> None:
    last = exchange.controller.sample(exchange.now_ns)
    exchange.now_ns += NS_PER_MS
    assert exchange.take(exchange.message(**changes(exchange))) == reason
    assert exchange.controller.refused[reason] > 0
    assert exchange.controller.sample(exchange.now_ns) is last
    assert exchange.take(exchange.message()) == ""


def exchanged(ways_ms: int, ago_ns: int) -> tuple[str, int]:
    """What becomes of a sample that was sent so long ago, and its age at most.

    ways_ms: of an exchange before it, whose echo it carries as well.
    """
    controller = LinkController(LinkConfig(max_age_ms=100.0), lambda _: None, lambda _: None)
    start_ns, ways_ns = HOUR_NS, ways_ms * NS_PER_MS
    hand = Exchange().hand.read(0, 0.0)
    echo_ns, echoed_ns = start_ns, start_ns + ways_ns
    back_ns = start_ns + 2 * ways_ns
    assert controller.take(hand_message(hand, echoed_ns, echo_ns, echoed_ns), back_ns) == ""
    now_ns = start_ns + NS_PER_S // 2
    sent_ns = now_ns - ago_ns
    refusal = controller.take(hand_message(hand, sent_ns, echo_ns, echoed_ns), now_ns)
    age_ns = controller.clock.age_ns(sent_ns, echo_ns, now_ns)
    assert age_ns is not None
    return refusal, age_ns


@given(st.integers(0, 40), st.integers(0, 130 * NS_PER_MS) | st.integers(89_000_000, 100_000_000))
def test_a_sample_counts_up_to_its_bound_by_the_clocks(ways_ms: int, ago_ns: int) -> None:
    refusal, age_ns = exchanged(ways_ms, ago_ns)
    assert refusal == ("" if age_ns <= 100 * NS_PER_MS else "too old")
    assert ago_ns <= age_ns <= ago_ns + ways_ms * NS_PER_MS + NS_PER_MS


def test_a_sample_at_the_bound_counts_and_none_beyond() -> None:
    limit_ns = 100 * NS_PER_MS
    ago_ns = bisect_right(range(limit_ns), limit_ns, key=lambda ago_ns: exchanged(0, ago_ns)[1])
    assert exchanged(0, ago_ns - 1) == ("", limit_ns)
    refusal, age_ns = exchanged(0, ago_ns)
    assert refusal == "too old"
    assert limit_ns < age_ns <= limit_ns + 2


def test_a_sample_whose_sender_was_answered_a_second_ago_counts(exchange: Exchange) -> None:
    assert exchange.take(exchange.message(echo_ns=exchange.now_ns - 1000 * NS_PER_MS)) == ""


HALF = 0.5**0.5


@pytest.mark.parametrize(
    "rotation", [(1, 0, 0, 0), (0, 1, 0, 0), (0, 0, 1, 0), (0, 0, 0, 1), (HALF, 0, 0, -HALF)]
)
@pytest.mark.parametrize(
    ("size", "reason"),
    [(1.0009, ""), (0.9991, ""), (1.0011, "without a rotation"), (0.9989, "without a rotation")],
)
def test_every_rotation_counts_if_its_quaternion_is_as_long_as_one_to_a_thousandth(
    exchange: Exchange, rotation: tuple[float, ...], size: float, reason: str
) -> None:
    pose = (0.0, 1.0, 0.0, *(size * part for part in rotation))
    assert exchange.take(exchange.message(pose=pose)) == reason


def test_a_position_that_is_no_number_reaches_the_safety_logic_which_holds() -> None:
    bench, exchange = engaged_bench()
    exchange.hand.position = np.full(3, np.nan)
    outputs = [bench.tick(sample=exchange.tick()) for _ in range(4)]
    output = outputs[-1]
    assert (output.arming, output.reason) == (ArmingState.HOLDING, Reason.BAD_INPUT)


# --- outages --------------------------------------------------------------------------------------


def test_a_gap_begins_after_its_time_and_the_link_is_lost_after_its_own_and_not_before(
    exchange: Exchange,
) -> None:
    message = exchange.message()
    exchange.now_ns += DELAY_NS
    heard_ns, config = exchange.now_ns, exchange.config
    assert exchange.take(message) == ""
    gap_ns = round(config.lost_after_ms * NS_PER_MS)
    lost_ns = round(config.fault_after_ms * NS_PER_MS)
    exchange.on_their_way.clear()
    after_ns = (gap_ns, gap_ns + 1, lost_ns - 1, lost_ns)
    statuses = [exchange.controller.sample(heard_ns + ns).status for ns in after_ns]
    assert statuses == [OK, GAP, GAP, LOST]


def test_who_comes_back_within_a_gap_is_there_again_and_the_next_gap_has_its_own_time(
    exchange: Exchange,
) -> None:
    for _ in range(3):
        exchange.up = lambda _: None
        assert {sample.status for sample in exchange.run_ms(2000)[20:]} == {GAP}
        exchange.up = lambda _: DELAY_NS
        assert {sample.status for sample in exchange.run_ms(2000)[5:]} == {OK}


def test_who_has_left_is_gone_at_once_until_the_next_one_comes(exchange: Exchange) -> None:
    exchange.controller.let_go(left=True)
    exchange.on_their_way.clear()
    exchange.up = lambda _: None
    assert {sample.status for sample in exchange.run_ms(4000)} == {LEFT}
    exchange.controller.let_go()
    exchange.up = lambda _: DELAY_NS
    assert exchange.tick().status is LOST
    assert exchange.run_ms(200)[-1].status is OK


def test_messages_that_do_not_count_do_not_keep_the_link(exchange: Exchange) -> None:
    exchange.down = lambda _: None  # so that echoes grow old
    samples = exchange.run_ms(5000)
    lost = [sample.status for sample in samples].index(GAP)
    limit_ms = exchange.config.stopped_after_ms
    assert lost * TICK_NS < (limit_ms + 20) * NS_PER_MS
    assert {sample.status for sample in samples[lost:]} == {GAP, LOST}
    assert samples[-1].status is LOST


def test_a_queue_on_the_way_back_makes_no_sample_old(exchange: Exchange) -> None:
    """As the queue of the video does, behind which our stamps wait for the operator's side."""
    exchange.down = lambda now_ns: DELAY_NS + 700 * NS_PER_MS
    assert {sample.status for sample in exchange.run_ms(5000)} == {OK}
    assert set(exchange.taken) == {""} | ({"without an echo"} & set(exchange.taken))


def test_a_queue_on_the_hands_way_makes_samples_old(exchange: Exchange) -> None:
    exchange.up = lambda now_ns: DELAY_NS + 260 * NS_PER_MS
    assert GAP in {sample.status for sample in exchange.run_ms(1000)}
    assert exchange.taken[-1] == "too old"


def test_a_burst_of_what_was_queued_for_two_seconds_moves_nothing(exchange: Exchange) -> None:
    start_ns = exchange.now_ns
    end_ns = start_ns + 2 * NS_PER_S
    exchange.up = exchange.down = queued(start_ns, end_ns, DELAY_NS)  # both ways at once
    exchange.hand.velocity = np.array([0.25, 0.0, 0.0])
    exchange.run_ms(50)  # two were on their way
    assert not new_poses(exchange.run_ms(1850), start_ns + DELAY_NS)
    old = [message for _, message in exchange.on_their_way]
    assert len(old) > 200
    while exchange.now_ns < end_ns:
        exchange.tick()
    refused = exchange.controller.refused.total()
    for message in old:
        assert exchange.take(message) in ("too old", "unanswered")
        assert exchange.controller.sample(exchange.now_ns).status is GAP
    assert exchange.controller.refused.total() == refused + len(old)
    exchange.run_ms(100)
    assert exchange.tick().status is OK


@settings(max_examples=40)
@given(
    outage_ms=st.integers(300, 3000),
    delay_ms=st.integers(0, 24),
    down_too=st.booleans(),
)
def test_no_sample_that_counts_is_older_than_the_bound(
    outage_ms: int, delay_ms: int, down_too: bool
) -> None:
    exchange = Exchange(delay_ms=delay_ms).settled()
    start_ns = exchange.now_ns
    way = queued(start_ns, start_ns + outage_ms * NS_PER_MS, delay_ms * NS_PER_MS)
    exchange.up = way
    if down_too:
        exchange.down = way
    sent_ns: dict[bytes, int] = {}
    longest_ns = exchange.config.longest_age_ms() * NS_PER_MS
    lost_ns = exchange.config.lost_after_ms * NS_PER_MS
    exchange.hand.velocity = np.array([0.25, 0.0, 0.0])
    for _ in range(round((outage_ms + 500) * NS_PER_MS / TICK_NS)):
        sample = exchange.tick()
        sent_ns[exchange.hand.position.tobytes()] = exchange.now_ns
        if sample.status is OK and sample.pose is not None:
            made_ns = sent_ns.get(sample.pose.position.tobytes(), start_ns)
            assert exchange.now_ns - made_ns <= longest_ns + lost_ns
    assert exchange.tick().status is OK


def test_after_the_computer_was_suspended_only_what_answers_a_later_stamp_counts(
    exchange: Exchange,
) -> None:
    exchange.controller.wake(exchange.now_ns)
    statuses = [sample.status for sample in exchange.run_ms(300)]
    first = statuses.index(OK)
    assert set(statuses[:first]) == {LOST}
    assert 40 <= first * TICK_NS / NS_PER_MS <= 60  # a round trip
    assert set(statuses[first:]) == {OK}
    assert exchange.taken[-len(statuses) :].count("without an echo") == first


def test_no_stamp_from_before_a_suspend_counts_for_the_next_operator_either(
    exchange: Exchange,
) -> None:
    before_ns = exchange.now_ns
    exchange.now_ns += 1
    exchange.controller.wake(exchange.now_ns)
    exchange.controller.let_go()
    exchange.on_their_way.clear()
    message = exchange.message(echo_ns=before_ns, echo_heard_ns=before_ns + exchange.offset_ns)
    assert exchange.take(message) == "without an echo"


def test_once_an_operator_was_let_go_times_are_those_of_what_comes_then(exchange: Exchange) -> None:
    """A pose is as old as it is, also where one of before was newer."""
    last = exchange.tick()
    exchange.controller.let_go()
    assert [exchange.tick().status for _ in range(2)] == [LOST, OK], "lost once, whoever is heard"
    exchange.controller.let_go()
    exchange.controller.sample(exchange.now_ns)
    there_ns = exchange.now_ns + exchange.offset_ns
    old_ns = there_ns - 90 * NS_PER_MS
    assert exchange.take(exchange.message(pose_ns=old_ns, buttons_ns=old_ns)) == ""
    sample = exchange.controller.sample(exchange.now_ns)
    assert sample.pose_ns == sample.buttons_ns == exchange.now_ns - 90 * NS_PER_MS < last.pose_ns


@pytest.mark.parametrize("gap_ms", [150, 2000])
def test_after_a_gap_times_are_based_anew(exchange: Exchange, gap_ms: int) -> None:
    exchange.up = lambda _: None
    assert exchange.run_ms(gap_ms)[-1].status is GAP
    exchange.up = lambda _: 60 * NS_PER_MS  # the way back is longer
    sample = exchange.run_ms(200)[-1]
    assert sample.status is OK
    assert exchange.now_ns - sample.pose_ns < 2 * TICK_NS  # by the longer way, not the former


def test_a_gap_that_is_no_loss_keeps_the_times(exchange: Exchange) -> None:
    exchange.up = lambda _: None
    exchange.run_ms(60)
    exchange.up = lambda _: DELAY_NS + 30 * NS_PER_MS
    sample = exchange.run_ms(100)[-1]
    assert sample.status is OK
    assert exchange.now_ns - sample.pose_ns >= 30 * NS_PER_MS  # later than the best way


# --- the operator's clock -------------------------------------------------------------------------


@pytest.mark.parametrize("jump_ns", [-HOUR_NS, HOUR_NS, -NS_PER_S, NS_PER_S])
@pytest.mark.parametrize("moving", [False, True])
def test_a_clock_that_jumps_never_makes_an_old_pose_new(
    exchange: Exchange, jump_ns: int, moving: bool
) -> None:
    exchange.hand.velocity = np.array([0.1, 0.0, 0.0])
    exchange.run_ms(200)
    exchange.hand.frozen = not moving  # then the pose keeps its time of before
    exchange.run_ms(50)
    frozen_ns = exchange.now_ns
    exchange.offset_ns += jump_ns
    samples = exchange.run_ms(2000)
    if not moving:
        lost = next((n for n, s in enumerate(samples) if s.status is GAP), len(samples))
        assert not new_poses(samples[:lost], frozen_ns)
        # once the link is lost the arm is stopped; that the hand keeps still is seen all the same
        assert len({sample.pose_ns for sample in samples[lost:] if sample.status is OK}) <= 1
        exchange.hand.frozen = False
    recovered = exchange.run_ms(400)
    assert recovered[-1].status is OK
    assert exchange.now_ns - recovered[-1].pose_ns < 3 * TICK_NS + DELAY_NS


@pytest.mark.parametrize("jump_ns", [-HOUR_NS, -NS_PER_S])
def test_a_clock_that_jumps_back_makes_a_gap(exchange: Exchange, jump_ns: int) -> None:
    exchange.offset_ns += jump_ns
    statuses = [sample.status for sample in exchange.run_ms(400)]
    first = statuses.index(GAP)
    assert 100 <= first * TICK_NS / NS_PER_MS <= 150
    assert statuses[first + 2 :] == [OK] * len(statuses[first + 2 :])


ROUNDING_NS = 10


def hand_took_ns(before: ControllerSample, after: ControllerSample) -> float:
    """How long a hand at 0.25 m/s takes from the one pose to the other."""
    assert before.pose is not None
    assert after.pose is not None
    return float(np.linalg.norm(after.pose.position - before.pose.position)) / 0.25 * NS_PER_S


@settings(max_examples=40)
@given(JUMPS_NS, JUMPS_NS)
def test_no_jumps_make_the_arm_faster_than_the_hand(first_ns: int, second_ns: int) -> None:
    """With each jump the link is lost, or the pose's times go on at the hand's pace or slower.

    What a jump of less than 5 ms has added is taken back, a third of a tick in a tick at most.
    """
    exchange = Exchange().settled()
    exchange.hand.velocity = np.array([0.25, 0.0, 0.0])
    last = exchange.run_ms(200)[-1]
    for jump_ns in (first_ns, second_ns):
        exchange.offset_ns += jump_ns
        start = last
        for sample in exchange.run_ms(600):
            if sample.status is OK and last.status is OK and sample.pose_ns > last.pose_ns:
                passed_ns = sample.pose_ns - last.pose_ns
                assert hand_took_ns(last, sample) <= passed_ns * 4 / 3 + ROUNDING_NS
                if start.status is OK:
                    whole_ns = sample.pose_ns - start.pose_ns
                    assert hand_took_ns(start, sample) <= whole_ns + ROUNDING_NS
            last = sample


@pytest.mark.parametrize(
    ("before_ms", "after_ms", "pose_age_ms"),
    [
        *((60, 20, 0), (110, 10, 0), (25, 21, 0), (60, 55, 0), (30, 0, 0), (20, 70, 0)),
        *((60, 20, 20), (110, 10, 20), (30, 0, 20)),
    ],
)
def test_a_way_that_becomes_shorter_makes_the_hand_no_faster(
    before_ms: int, after_ms: int, pose_age_ms: int
) -> None:
    """Also where the hand's own poses come later from then on."""
    exchange = Exchange(delay_ms=before_ms).settled()
    exchange.hand.velocity = np.array([0.25, 0.0, 0.0])
    exchange.run_ms(500)
    delay_ns = after_ms * NS_PER_MS
    exchange.up = lambda _now_ns: delay_ns
    exchange.hand.pose_age_ns = pose_age_ms * NS_PER_MS
    last, fastest_m_s, moved_m = exchange.tick(), 0.0, 0.0
    for sample in exchange.run_ms(1500):
        interval_s = (sample.pose_ns - last.pose_ns) / NS_PER_S
        if 0 < interval_s <= 0.05:  # else the hand begins anew
            step_m = float(np.linalg.norm(sample.pose.position - last.pose.position))
            fastest_m_s = max(fastest_m_s, step_m / interval_s)
            moved_m += step_m
        last = sample
    assert fastest_m_s <= 0.25 * 4 / 3 + 1e-6
    assert moved_m >= 0.25 * 1.5 - 0.25 * 0.4, "it goes on within .4 s"


@pytest.mark.parametrize(
    ("jitter_ms", "bound_ms"), [(0, 5), (5, 5), (30, 30), (50, 50), (51, 50), (400, 50)]
)
@pytest.mark.parametrize("lost", [0, 2])
def test_poses_wait_where_a_way_becomes_shorter_by_more_than_its_jitter(
    jitter_ms: float, bound_ms: int, lost: int
) -> None:
    """By 5 ms it may without, by more than 50 never; whether messages are lost meanwhile or not."""
    for shorter_ns in (bound_ms * NS_PER_MS, bound_ms * NS_PER_MS + 1):
        exchange = Exchange(LinkConfig(jitter_ms=jitter_ms), delay_ms=80).settled()
        exchange.up = lambda _: None
        exchange.run_ms(lost * TICK_NS / NS_PER_MS)
        delay_ns = 80 * NS_PER_MS - shorter_ns
        exchange.up = lambda _, delay_ns=delay_ns: delay_ns  # type: ignore[misc]
        stands = [len(list(same)) for _, same in groupby(s.pose_ns for s in exchange.run_ms(400))]
        assert (max(stands) * TICK_NS >= 40 * NS_PER_MS) == (shorter_ns > bound_ms * NS_PER_MS)


def test_what_a_way_becomes_shorter_by_is_taken_back_within_four_times_as_long() -> None:
    exchange = Exchange(LinkConfig(jitter_ms=40), delay_ms=80).settled()
    exchange.up = lambda _: 40 * NS_PER_MS
    samples = exchange.run_ms(100)
    assert samples[-1].pose_ns > exchange.now_ns, "newer than the hand can be"
    last = exchange.run_ms(60 + 2 * TICK_NS / NS_PER_MS)[-1]
    assert exchange.now_ns - TICK_NS <= last.pose_ns <= exchange.now_ns


def now_and_then(early_ns: int, every: int, way_ns: int = DELAY_NS) -> Callable[[int], int]:
    """A way on which each so many-th message is `early_ns` faster than the others."""
    count = 0

    def delay(_now_ns: int) -> int:
        nonlocal count
        count += 1
        return way_ns - (0 if count % every else early_ns)

    return delay


@pytest.mark.parametrize(("way_ms", "early_ms"), [(20, 20), (40, 40), (100, 30)])
@pytest.mark.parametrize("every", [12, 24])
def test_single_messages_that_come_early_make_no_gap_and_no_hand_faster(
    way_ms: int, early_ms: int, every: int
) -> None:
    """As those that another computer has copied and carries faster; what they overtake is lost."""
    exchange = Exchange(delay_ms=way_ms).settled()
    exchange.hand.velocity = np.array([0.25, 0.0, 0.0])
    exchange.run_ms(way_ms + 50)
    exchange.up = now_and_then(early_ms * NS_PER_MS, every, way_ms * NS_PER_MS)
    last = exchange.tick()
    for _ in range(240):
        sample = exchange.tick()
        assert sample.status is OK
        assert exchange.now_ns - sample.pose_ns <= (early_ms + 10) * NS_PER_MS + TICK_NS
        if sample.pose_ns > last.pose_ns:
            assert hand_took_ns(last, sample) == pytest.approx(sample.pose_ns - last.pose_ns)
            last = sample


def test_buttons_of_a_message_that_comes_early_count_and_what_it_overtakes_does_not(
    exchange: Exchange,
) -> None:
    exchange.hand.trigger = 1.0
    before = exchange.run_ms(100)[-1]
    assert before.trigger == 1.0
    exchange.hand.trigger = 0.0
    exchange.up = lambda _: 0
    early = exchange.tick()
    assert (early.trigger, early.buttons_ns) == (0.0, exchange.now_ns)
    assert early.pose_ns <= before.pose_ns + TICK_NS
    exchange.up = lambda _: DELAY_NS
    exchange.hand.trigger = 0.5
    samples = exchange.run_ms(100)
    assert [one for one, _ in groupby(sample.trigger for sample in samples)] == [0.0, 0.5]
    assert samples[1].pose_ns == early.pose_ns


def test_a_pose_that_is_lost_in_a_message_that_comes_early_is_lost_until_a_newer_one_has_it(
    exchange: Exchange,
) -> None:
    before = exchange.run_ms(100)[-1]
    exchange.hand.tracked, exchange.hand.status = False, ControllerStatus.TRACKING_LOST
    exchange.up = lambda _: 0
    early = exchange.tick()
    assert (early.status, early.pose) == (ControllerStatus.TRACKING_LOST, None)
    exchange.hand.tracked, exchange.hand.status = True, OK
    exchange.up = lambda _: DELAY_NS
    behind = exchange.run_ms(DELAY_NS / NS_PER_MS)
    assert {(one.status, one.pose) for one in behind} == {(ControllerStatus.TRACKING_LOST, None)}
    after = exchange.run_ms(50)[-1]
    assert after.status is OK
    assert after.pose is not None
    assert after.pose_ns > before.pose_ns


def test_early_messages_alone_do_not_keep_a_link_whose_poses_do_not_come(
    exchange: Exchange,
) -> None:
    """Two of them less than 51 ms apart, and nothing else."""
    start_ns = exchange.now_ns
    early_ns = (start_ns + 60 * NS_PER_MS, start_ns + 105 * NS_PER_MS)
    exchange.up = lambda now_ns: 0 if any(0 <= now_ns - one < TICK_NS for one in early_ns) else None
    statuses = [one.status for one in exchange.run_ms(140)]
    assert GAP in statuses
    assert statuses.index(GAP) * TICK_NS / NS_PER_MS <= 130


def test_a_way_that_is_shorter_for_50_ms_is_the_way_and_one_longer_message_makes_it_not(
    exchange: Exchange,
) -> None:
    def stands_ms(duration_ms: float) -> float:
        """How old the pose is after that."""
        sample = exchange.run_ms(duration_ms)[-1]
        return (exchange.now_ns - sample.pose_ns) / NS_PER_MS

    for _ in range(2):
        exchange.up = lambda _: 0
        assert stands_ms(60) > 35, "what was on its way came, and then 40 ms early ones alone"
        exchange.up = lambda _: DELAY_NS
        assert stands_ms(45) < 20
    exchange.up = lambda _: 0
    assert stands_ms(60) > 35
    assert stands_ms(30) < 20


def test_messages_in_any_order_and_twice_count_only_as_they_grow_newer() -> None:
    exchange = Exchange(LinkConfig(jitter_ms=50)).settled()
    exchange.now_ns += NS_PER_S // 20
    messages = []
    for _ in range(40):
        exchange.now_ns += NS_PER_MS
        messages.append(exchange.message(echo_ns=exchange.now_ns - 30 * NS_PER_MS))
    order = np.random.default_rng(0).permutation(2 * len(messages))
    newest = -1
    for index in order % len(messages):
        expected = "" if index > newest else "overtaken"
        newest = max(newest, index)
        assert exchange.take(messages[index]) == expected


# --- with the teleoperation -----------------------------------------------------------------------


def engaged_bench() -> tuple[Bench, Exchange]:
    """The robot's side with an operator who is engaged, at rest."""
    bench = Bench(for_robot(make_config()))
    exchange = Exchange(bench.config.link, now_ns=bench.now_ns, offset_ns=5 * HOUR_NS).settled()
    bench.now_ns = exchange.now_ns
    bench.tick(sample=exchange.tick())
    bench.arm_ready = True
    bench.tick(sample=exchange.tick(), confirm=True)
    exchange.hand.trigger = 1.0
    for _ in range(30):
        output = bench.tick(sample=exchange.tick())
    assert output.arming is ArmingState.ENGAGED
    assert bench.now_ns == exchange.now_ns
    return bench, exchange


def run(bench: Bench, exchange: Exchange, duration_ms: float) -> None:
    for _ in range(round(duration_ms * NS_PER_MS / TICK_NS)):
        bench.tick(sample=exchange.tick())


def goes_on_by_releasing_and_pressing(bench: Bench, exchange: Exchange) -> None:
    assert bench.outputs[-1].arming is ArmingState.HOLDING
    exchange.hand.trigger = 0.0
    run(bench, exchange, 100)
    assert bench.outputs[-1].arming is ArmingState.READY
    assert not np.any(bench.linear()[-10:])
    exchange.hand.trigger = 1.0
    run(bench, exchange, 300)
    assert bench.outputs[-1].arming is ArmingState.ENGAGED


def travel_through_a_gap(gap_ms: float, moves: bool) -> np.ndarray:
    """Velocities commanded around a gap; a hand of 250 mm/s, which may stand still in the gap."""
    bench, exchange = engaged_bench()
    velocity = hand_for((0.0, 0.25, 0.0), bench.config)
    exchange.hand.velocity = velocity
    run(bench, exchange, 400)
    start = len(bench.outputs)
    exchange.up = lambda _: None
    exchange.hand.velocity = velocity if moves else np.zeros(3)
    run(bench, exchange, gap_ms)
    exchange.up = lambda _: DELAY_NS
    exchange.hand.velocity = velocity
    run(bench, exchange, 400)
    assert bench.outputs[-1].arming is ArmingState.ENGAGED
    return bench.linear()[start:]


@pytest.mark.parametrize("gap_ms", [60, 70, 80, 90])
def test_nothing_of_a_gap_is_made_up_for(gap_ms: int) -> None:
    """What the arm does is the same to the last digit whatever the hand did in the gap."""
    moved, stood = (travel_through_a_gap(gap_ms, moves) for moves in (True, False))
    assert moved == pytest.approx(stood, abs=1e-9)
    assert np.linalg.norm(moved, axis=1).max() < 0.26
    assert np.linalg.norm(moved[-1]) == pytest.approx(0.25, rel=0.01)


class Swing:
    """A hand that swings ±35 mm along y, once a second; who sees it decides what arrives."""

    def __init__(self, fate: Callable[[bool, int], int | None]) -> None:
        """`fate`: of a message, by whether the hand swings back and the time: its delay [ns]."""
        self.bench, self.exchange = engaged_bench()
        self._start_ns, self._fate = self.exchange.now_ns, fate
        self._start_m = self.bench.arm.pose.position.copy()

    def for_s(self, duration_s: float) -> None:
        for _ in range(round(duration_s * NS_PER_S / TICK_NS)):
            since_s = (self.exchange.now_ns - self._start_ns) / NS_PER_S
            speed_m_s = 0.035 * math.tau * math.cos(math.tau * since_s)
            self.exchange.hand.velocity = hand_for((0.0, speed_m_s, 0.0), self.bench.config)
            self.exchange.up = partial(self._fate, speed_m_s < 0)
            self.bench.tick(sample=self.exchange.tick())

    @property
    def drift_mm(self) -> float:
        """From where the arm began, at the end of a whole number of swings."""
        return 1000.0 * float(np.linalg.norm(self.bench.arm.pose.position - self._start_m))

    @property
    def hold(self) -> Reason | None:
        """What stopped it first."""
        states = [output.arming for output in self.bench.outputs]
        if ArmingState.HOLDING not in states:
            return None
        return self.bench.outputs[states.index(ArmingState.HOLDING)].reason


def one_in_75_ms() -> Callable[[bool, int], int | None]:
    """While the hand swings back, a message passes each 75 ms: gaps that are no lost link."""
    passed_ns = 0

    def fate(back: bool, now_ns: int) -> int | None:
        nonlocal passed_ns
        if back and now_ns - passed_ns < 75 * NS_PER_MS:
            return None
        passed_ns = now_ns
        return DELAY_NS

    return fate


def late_while_back(back: bool, _now_ns: int) -> int:
    """Nothing is lost; what the hand does while it swings back comes 55 ms later."""
    return DELAY_NS + 55 * NS_PER_MS * back


def early_now_and_then() -> Callable[[bool, int], int | None]:
    """Single messages come 20 ms early."""
    early = now_and_then(DELAY_NS, 24)
    return lambda _back, now_ns: early(now_ns)


@pytest.mark.parametrize("fate", [lambda _back, _now_ns: DELAY_NS, early_now_and_then()])
def test_a_swing_is_followed_of_which_all_arrives_and_some_early(
    fate: Callable[[bool, int], int | None],
) -> None:
    swing = Swing(fate)
    swing.for_s(3.0)
    assert swing.hold is None
    assert swing.drift_mm < 20


@pytest.mark.parametrize("fate", [one_in_75_ms(), late_while_back])
def test_who_drops_or_delays_what_the_hand_does_on_its_way_back_cannot_lead_the_arm_away(
    fate: Callable[[bool, int], int | None],
) -> None:
    swing = Swing(fate)
    swing.for_s(3.0)
    assert swing.hold in (Reason.LINK_GAPS, Reason.HAND_NOT_FOLLOWED)
    assert swing.drift_mm < 60


def gaps(exchange: Exchange, count: int, gap_ms: float, every_ms: float) -> list[ControllerSample]:
    """So many gaps in what arrives."""
    samples = []
    for _ in range(count):
        exchange.up = lambda _: None
        samples += exchange.run_ms(gap_ms)
        exchange.up = lambda _: DELAY_NS
        samples += exchange.run_ms(every_ms - gap_ms)
    return samples


@pytest.mark.parametrize(
    ("count", "gap_ms", "every_ms", "too_many"),
    [(3, 75, 300, True), (2, 75, 300, False), (3, 75, 600, False), (5, 33, 150, False)],
)
def test_three_gaps_beyond_the_bridge_within_a_second_are_too_many(
    exchange: Exchange, count: int, gap_ms: float, every_ms: float, too_many: bool
) -> None:
    statuses = {sample.status for sample in gaps(exchange, count, gap_ms, every_ms)}
    assert statuses == ({OK, ControllerStatus.LINK_GAPS} if too_many else {OK})


def jittery(late_ms: float) -> Callable[[int], int]:
    """A way on which more than half, and less than two thirds, of what arrives is so late."""
    index = 0

    def way(_now_ns: int) -> int:
        nonlocal index
        index += 1
        return DELAY_NS + round(late_ms * NS_PER_MS) * (index % 12 >= 4)

    return way


def gaps_in_jitter(exchange: Exchange, lost: int, late_ms: float) -> set[ControllerStatus]:
    """Three times so many samples in a row are lost, on a way with jitter."""
    samples = []
    for _ in range(3):
        exchange.up = jittery(late_ms)
        samples += exchange.run_ms(300)
        exchange.up = lambda _: None
        samples += [exchange.tick() for _ in range(lost)]
    exchange.up = lambda _: DELAY_NS
    return {sample.status for sample in samples + exchange.run_ms(50)}


# A sample that is 7 ticks after the last is 8 ms beyond the bridge of 50 ms, the next one 17 ms.
@pytest.mark.parametrize(
    ("late_ms", "lost", "too_many"),
    [(0, 5, False), (0, 6, True), (15, 6, False), (15, 7, True), (40, 8, False), (40, 9, True)],
)
def test_what_half_of_the_samples_take_more_is_no_gap(
    exchange: Exchange, late_ms: float, lost: int, too_many: bool
) -> None:
    exchange.up = jittery(late_ms)
    exchange.run_ms(1500)
    found = gaps_in_jitter(exchange, lost, late_ms)
    assert (ControllerStatus.LINK_GAPS in found) == too_many


def test_jitter_that_is_over_excuses_nothing_a_second_later(exchange: Exchange) -> None:
    exchange.up = jittery(15)
    exchange.run_ms(5000)
    exchange.up = lambda _: DELAY_NS
    exchange.run_ms(1200)
    assert ControllerStatus.LINK_GAPS in gaps_in_jitter(exchange, 6, 0)


def test_a_way_that_becomes_longer_for_good_is_one_gap(exchange: Exchange) -> None:
    """Until the times go by the longer way every sample is older than is bridged."""
    exchange.up = lambda _: DELAY_NS + 60 * NS_PER_MS
    assert {sample.status for sample in exchange.run_ms(1000)} == {OK}
    exchange.up = lambda _: DELAY_NS
    assert {sample.status for sample in gaps(exchange, 2, 75, 300)} == {OK}


def test_samples_that_are_refused_make_a_gap_as_lost_ones_do(exchange: Exchange) -> None:
    for _ in range(3):
        exchange.up = lambda _: None
        for _ in range(9):  # 75 ms
            exchange.tick()
            assert exchange.take(exchange.message(echo_ns=0)) == "without an echo"
        exchange.up = lambda _: DELAY_NS
        exchange.run_ms(150)
    assert exchange.tick().status is ControllerStatus.LINK_GAPS


@pytest.mark.parametrize("count", [3, 4, 5, 6])
def test_three_gaps_and_more_are_over_a_second_after_the_first_of_the_last_three_ended(
    exchange: Exchange, count: int
) -> None:
    gaps(exchange, count, 75, 150)
    assert exchange.tick().status is ControllerStatus.LINK_GAPS
    assert exchange.run_ms(1000)[-1].status is OK


def test_too_many_gaps_hold_until_the_trigger_was_released() -> None:
    bench, exchange = engaged_bench()
    for _ in range(3):
        exchange.up = lambda _: None
        run(bench, exchange, 75)
        exchange.up = lambda _: DELAY_NS
        run(bench, exchange, 150)
    output = bench.outputs[-1]
    assert (output.arming, output.reason) == (ArmingState.HOLDING, Reason.LINK_GAPS)
    run(bench, exchange, 1500)
    goes_on_by_releasing_and_pressing(bench, exchange)


@pytest.mark.parametrize(
    ("outage_s", "stops"),
    [
        (2.0, [(ArmingState.HOLDING, Reason.LINK_GAP)]),
        (3.5, [(ArmingState.HOLDING, Reason.LINK_GAP), (ArmingState.FAULT, Reason.LINK_LOST)]),
    ],
)
def test_an_outage_and_its_burst_are_a_hold_then_a_fault_and_no_motion(
    outage_s: float, stops: list[tuple[ArmingState, Reason]]
) -> None:
    bench, exchange = engaged_bench()
    exchange.hand.velocity = hand_for((0.0, 0.25, 0.0), bench.config)
    run(bench, exchange, 400)
    start_ns = exchange.now_ns
    end_ns = start_ns + round(outage_s * NS_PER_S)
    exchange.up = exchange.down = queued(start_ns, end_ns, DELAY_NS)
    first = len(bench.outputs)
    run(bench, exchange, outage_s * 1000 + 1000)
    after = bench.outputs[first:]
    stopped = [(one.arming, one.reason) for one in after if one.arming is not ArmingState.ENGAGED]
    assert list(dict.fromkeys(stopped)) == stops
    held = len(after) - len(stopped)
    limit_ns = bench.config.link.lost_after_ms * NS_PER_MS + DELAY_NS + 2 * TICK_NS
    assert held * TICK_NS <= limit_ns
    at_rest = first + held + round(REST_NS / TICK_NS)
    assert not np.any(bench.linear()[at_rest:])
    assert not np.any(bench.angular()[at_rest:])
    faults = [one for one in after if one.arming is ArmingState.FAULT]
    assert all(one.stop for one in faults[:1])
    assert exchange.tick().status is OK  # the link is back, the arm waits for the operator


def test_after_a_gap_the_hand_goes_on_by_releasing_and_pressing() -> None:
    bench, exchange = engaged_bench()
    exchange.hand.velocity = hand_for((0.0, 0.25, 0.0), bench.config)
    exchange.up = lambda _: None
    run(bench, exchange, 2500)
    exchange.up = lambda _: DELAY_NS
    run(bench, exchange, 1000)
    goes_on_by_releasing_and_pressing(bench, exchange)
    assert np.linalg.norm(bench.linear()[-1]) > 0.1


def test_a_hand_that_is_frozen_at_its_own_side_is_a_fault() -> None:
    bench, exchange = engaged_bench()
    exchange.hand.frozen = True
    run(bench, exchange, 1000)
    assert bench.outputs[-1].reason is Reason.POSE_FROZEN


# --- the configuration ----------------------------------------------------------------------------


@given(st.floats(0, 1000), st.floats(0, 400))
def test_a_round_trip_as_configured_is_never_too_old(latency_ms: float, jitter_ms: float) -> None:
    link = LinkConfig(latency_ms=latency_ms, jitter_ms=jitter_ms)
    assert link.longest_age_ms() >= 2 * (latency_ms + jitter_ms) + 100
    assert link.longest_silence_ms >= link.longest_age_ms()
    assert LinkConfig(latency_ms=latency_ms, max_age_ms=300).longest_age_ms(900) == 300


@given(st.floats(0, 5000))
def test_without_a_configuration_the_bound_follows_the_measured_round_trip(trip_ms: float) -> None:
    link = LinkConfig()
    assert link.longest_age_ms(trip_ms) == max(250.0, min(trip_ms + 200.0, 650.0))


@pytest.mark.parametrize("way_ms", [100, 200])
def test_without_a_configuration_a_far_link_works(way_ms: int) -> None:
    """With 25 ms of jitter each way, in order."""
    exchange, random = Exchange(), np.random.default_rng(4)

    def way(_: int) -> int:
        return round((way_ms + random.uniform(-25, 25)) * NS_PER_MS)

    exchange.up = exchange.down = way
    exchange.run_ms(1000)
    exchange.taken.clear()
    assert {sample.status for sample in exchange.run_ms(20_000)} == {OK}
    assert set(exchange.taken) <= {"", "overtaken"}


def test_no_configuration_lets_a_sample_of_more_than_three_seconds_move_the_arm() -> None:
    assert LinkConfig(latency_ms=1000, jitter_ms=400).longest_age_ms() == 3000
    with pytest.raises(ValidationError, match="jitter_ms"):
        LinkConfig(jitter_ms=401)
    with pytest.raises(ValidationError, match="max_age_ms"):
        LinkConfig(max_age_ms=3001)


def test_the_robots_side_adds_to_the_hands_age_what_the_link_may_take() -> None:
    config = make_config()
    fresh, link = config.freshness, config.link
    ours = for_robot(config).freshness
    assert ours.hold_pose_ms == link.bridge_ms
    assert ours.pose_frozen_ms == fresh.pose_frozen_ms + link.lost_after_ms
    assert ours.buttons_ms == fresh.buttons_ms + link.lost_after_ms


@pytest.mark.parametrize("asked", [600, 1162, 1163, 1400])
def test_no_datagram_of_the_link_carries_more_than_1200_bytes(asked: int) -> None:
    sent = for_robot(make_config(video__mtu_bytes=asked)).video.mtu_bytes
    assert sent == min(asked, 1162)
    assert sent + 7 + OVERHEAD_BYTES <= 1200
