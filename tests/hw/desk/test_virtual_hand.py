"""The hand that a device on a desk moves: laws of its motion."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.desk.keyboard import RAMP_S, Deflection, VirtualHand
from tams_app.config import DeskConfig, HandConfig, load_config
from tams_app.records import ControllerSample, ControllerStatus
from tams_app.rotation import Rotation
from tams_app.teleop.motion import HandMotion
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.vectors import Floats3, floats

pytestmark = pytest.mark.untimed

TICK_NS = 8 * NS_PER_MS
HELD = 1.0
axes = st.tuples(*[st.floats(-1.0, 1.0)] * 3)
PLAIN = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


def a_hand(rotation: tuple[Floats3, Floats3, Floats3] = PLAIN) -> VirtualHand:
    return VirtualHand(DeskConfig(), rotation)


def way(hand: VirtualHand, asked: Deflection, ticks: int, from_ns: int = 0) -> list[np.ndarray]:
    """Positions at each of so many ticks."""
    return [hand.step(from_ns + number * TICK_NS, asked).position.copy() for number in range(ticks)]


@given(st.lists(st.tuples(axes, axes, st.sampled_from([0.0, 1.0])), min_size=2, max_size=60))
def test_a_hand_is_never_faster_than_configured_and_never_jumps(
    asked: list[tuple[Floats3, Floats3, float]],
) -> None:
    hand, config = a_hand(), DeskConfig()
    poses = [
        hand.step(number * TICK_NS, Deflection(linear, angular, trigger))
        for number, (linear, angular, trigger) in enumerate(asked)
    ]
    tick_s = TICK_NS / NS_PER_S
    speeds = [(after.position - before.position) / tick_s for before, after in pairwise(poses)]
    turns = [
        np.array(before.rotation.turn_to(after.rotation)) / tick_s
        for before, after in pairwise(poses)
    ]
    share = tick_s / RAMP_S  # of full speed, that a tick may add
    for rates, most, slack in ((speeds, config.speed_m_s, 1e-9), (turns, config.turn_rad_s, 1e-6)):
        sizes = [float(np.linalg.norm(rate)) for rate in rates]
        assert max(sizes) <= most * (1 + slack)
        assert all(after - before <= most * share + slack for before, after in pairwise(sizes))


def test_a_hand_whose_deadman_is_let_go_stands_at_once_and_begins_slowly_again() -> None:
    hand = a_hand()
    forward = Deflection((1.0, 0.0, 0.0), trigger=HELD)
    way(hand, forward, 50)
    at = way(hand, Deflection((1.0, 0.0, 0.0)), 10, 50 * TICK_NS)
    assert np.ptp(at, axis=0).max() == 0.0
    again = way(hand, forward, 3, 60 * TICK_NS)
    first_speed = np.linalg.norm(again[1] - again[0]) / (TICK_NS / NS_PER_S)
    assert first_speed < DeskConfig().speed_m_s / 5


@pytest.mark.parametrize("gap_ns", [51 * NS_PER_MS, NS_PER_S, 3600 * NS_PER_S])
def test_nothing_is_made_up_for_after_a_gap(gap_ns: int) -> None:
    hand = a_hand()
    forward = Deflection((1.0, 0.0, 0.0), trigger=HELD)
    before = way(hand, forward, 50)[-1]
    after = hand.step(49 * TICK_NS + gap_ns, forward).position
    assert (after == before).all()


@pytest.mark.parametrize("gap_ns", [0, 51 * NS_PER_MS, NS_PER_S])
def test_a_hand_begins_slowly_again_after_a_gap_or_where_time_stands_still(gap_ns: int) -> None:
    hand = a_hand()
    forward = Deflection((1.0, 0.0, 0.0), trigger=HELD)
    way(hand, forward, 50)
    again = way(hand, forward, 2, 49 * TICK_NS + gap_ns)
    first_speed = np.linalg.norm(again[1] - again[0]) / (TICK_NS / NS_PER_S)
    assert 0.0 < first_speed < DeskConfig().speed_m_s / 5


def test_a_tick_that_is_as_long_as_may_be_still_counts_whole() -> None:
    """So long the next pose moves the arm (`HandMotion`)."""
    hand = a_hand()
    forward = Deflection((1.0, 0.0, 0.0), trigger=HELD)
    before = way(hand, forward, 50)[-1]
    after = hand.step(49 * TICK_NS + 50 * NS_PER_MS, forward).position
    assert after - before == pytest.approx([0.05 * DeskConfig().speed_m_s, 0.0, 0.0])


def test_a_hand_begins_where_it_is_whatever_is_held() -> None:
    for at_ns in (0, 1, NS_PER_S):
        assert not a_hand().step(at_ns, Deflection((1.0, 1.0, 1.0), trigger=HELD)).position.any()


@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3), axes)
def test_however_the_tracking_frame_lies_the_hand_moves_the_same_way_in_the_base_frame(
    turn: Floats3, asked: Floats3
) -> None:
    to_base = Rotation.from_rotvec(turn).as_matrix()
    first, second, third = (floats(row) for row in to_base)
    plain = way(a_hand(), Deflection(asked, trigger=HELD), 10)
    turned = way(a_hand((first, second, third)), Deflection(asked, trigger=HELD), 10)
    assert to_base @ turned[-1] == pytest.approx(plain[-1], abs=1e-12)


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_an_axis_moves_the_arm_along_the_same_axis_of_its_base(axis: int) -> None:
    """Through the configured mapping, which takes the tracking frame to the base frame."""
    config: HandConfig = load_config().hand
    hand = VirtualHand(DeskConfig(), config.rotation)
    direction = [0.0, 0.0, 0.0]
    direction[axis] = 1.0
    x, y, z = direction
    motion = HandMotion(config, 50 * NS_PER_MS)
    asked = Deflection((x, y, z), (x, y, z), trigger=HELD)
    for number in range(200):
        now_ns = (number + 1) * TICK_NS
        pose = hand.step(now_ns, asked)
        sample = ControllerSample.released(ControllerStatus.OK, pose, now_ns, now_ns, 1.0)
        if number == 0:
            motion.anchor(sample)
        twist = motion.update(sample, now_ns, TICK_NS / NS_PER_S)
    desk = DeskConfig()
    wanted = np.array(direction)
    assert np.array(twist.linear) == pytest.approx(
        wanted * desk.speed_m_s * config.translation_scale, abs=1e-4
    )
    assert np.array(twist.angular) == pytest.approx(
        wanted * desk.turn_rad_s * config.rotation_scale, abs=1e-3
    )
