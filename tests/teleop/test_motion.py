from __future__ import annotations

import math

import numpy as np
import pytest

from tams_app.config import HandConfig
from tams_app.records import ControllerSample, ControllerStatus, Pose
from tams_app.rotation import Rotation
from tams_app.teleop import motion as of_hand
from tams_app.teleop.motion import HandMotion, is_frozen
from tams_app.units import NS_PER_MS

pytestmark = pytest.mark.waiting

HOLD_NS = 25 * NS_PER_MS
PLAIN = ((1, 0, 0), (0, 1, 0), (0, 0, 1))


def sample(position: object, pose_ns: int, rotation: Rotation | None = None) -> ControllerSample:
    pose = Pose(np.array(position, dtype=float), rotation or Rotation.identity())
    return ControllerSample.released(ControllerStatus.OK, pose, pose_ns, pose_ns, 1.0)


@pytest.fixture(autouse=True)
def _unsmoothed(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(of_hand, "SMOOTHING_S", 1e-6)


def motion() -> HandMotion:
    return HandMotion(HandConfig(rotation=PLAIN), HOLD_NS)


def anchored() -> HandMotion:
    hand = motion()
    hand.anchor(sample((0, 0, 0), 0))
    return hand


def moved(hand: HandMotion, velocity: float) -> np.ndarray:
    """The twist after one pose that is 8 ms later and moved at `velocity`."""
    hand.anchor(sample((0, 0, 0), 0))
    return hand.update(sample((velocity * 0.008, 0, 0), 8 * NS_PER_MS), 8 * NS_PER_MS, 1.0).linear


@pytest.mark.parametrize(
    ("speed", "expected"), [(0.1, 0.1), (1.5, 1.5), (1.6, 1.5), (3.99, 1.5), (4.01, 0.0)]
)
def test_speeds_pass_are_clamped_or_rejected(speed: float, expected: float) -> None:
    np.testing.assert_allclose(moved(motion(), speed), [expected, 0, 0], atol=1e-9)


@pytest.mark.parametrize(("speed", "expected"), [(5.9, 5.9), (7.0, 6.0), (15.1, 0.0)])
def test_turning_speeds_pass_are_clamped_or_rejected(speed: float, expected: float) -> None:
    hand = anchored()
    turn = Rotation.from_rotvec([0, speed * 0.008, 0])
    twist = hand.update(sample((0, 0, 0), 8 * NS_PER_MS, turn), 8 * NS_PER_MS, 1.0)
    np.testing.assert_allclose(twist.angular, [0, expected, 0], atol=1e-9)


def test_velocities_are_of_the_tracking_frame_and_mapped_with_their_scales() -> None:
    config = HandConfig(translation_scale=0.5, rotation_scale=2.0)
    hand = HandMotion(config, HOLD_NS)
    start = Rotation.from_rotvec(np.radians([40, 50, 60]))
    hand.anchor(sample((0, 0, 0), 0, start))
    turn = Rotation.from_rotvec([0.004, 0.0, 0.0])
    twist = hand.update(sample((0, 0, -0.004), 10 * NS_PER_MS, turn * start), 10**7, 1.0)
    np.testing.assert_allclose(twist.linear, [0.2, 0, 0], atol=1e-9)  # away from the operator: +x
    np.testing.assert_allclose(twist.angular, [0, -0.8, 0], atol=1e-9)


def test_an_unchanged_pose_keeps_its_velocity_for_the_hold_time_and_no_longer() -> None:
    hand = motion()
    moved(hand, 0.2)
    same = sample((0.2 * 0.008, 0, 0), 8 * NS_PER_MS)
    assert hand.update(same, 8 * NS_PER_MS + HOLD_NS, 1.0).linear[0] == pytest.approx(0.2)
    assert hand.update(same, 8 * NS_PER_MS + HOLD_NS + 1, 1.0).linear[0] == 0.0


@pytest.mark.parametrize(("gap_ns", "speed"), [(50 * NS_PER_MS, 0.2), (50 * NS_PER_MS + 1, 0.0)])
def test_after_a_gap_of_more_than_50_ms_the_hand_begins_anew(gap_ns: int, speed: float) -> None:
    hand = anchored()
    twist = hand.update(sample((0.01, 0, 0), gap_ns), gap_ns, 1.0)
    assert twist.linear[0] == pytest.approx(speed)


def test_rejects_in_a_row_become_impossible_and_one_good_pose_forgives() -> None:
    hand = anchored()
    for k in range(1, 3):
        hand.update(sample((k % 2, 0, 0), k * 8 * NS_PER_MS), k * 8 * NS_PER_MS, 0.008)
    assert (hand.rejects, hand.impossible) == (2, False)
    hand.update(sample((0, 0, 0), 24 * NS_PER_MS), 24 * NS_PER_MS, 0.008)
    assert hand.rejects == 0
    for k in range(4, 10):
        assert not hand.impossible
        hand.update(sample((k % 2 + 1, 0, 0), k * 8 * NS_PER_MS), k * 8 * NS_PER_MS, 0.008)
    assert hand.impossible


def test_a_single_jump_moves_nothing() -> None:
    hand = anchored()
    for k in range(1, 20):
        at = (0.5, 0, 0) if k >= 3 else (0, 0, 0)
        twist = hand.update(sample(at, k * 8 * NS_PER_MS), k * 8 * NS_PER_MS, 0.008)
        assert not any(twist.linear)


def test_anchoring_forgets_what_the_hand_did_before(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(of_hand, "SMOOTHING_S", 0.05)
    hand = motion()
    moved(hand, 1.0)
    hand.anchor(sample((3, 3, 3), 100 * NS_PER_MS))
    twist = hand.update(sample((3, 3, 3), 100 * NS_PER_MS), 108 * NS_PER_MS, 0.008)
    assert twist.is_zero


@pytest.mark.parametrize("ticks", [1, 2, 7, 40])
def test_smoothing_does_not_depend_on_the_tick_rate(
    monkeypatch: pytest.MonkeyPatch, ticks: int
) -> None:
    monkeypatch.setattr(of_hand, "SMOOTHING_S", 0.04)
    hand = anchored()
    moving = sample((0.0016, 0, 0), 8 * NS_PER_MS)
    for _ in range(ticks):
        twist = hand.update(moving, 8 * NS_PER_MS, 0.02 / ticks)
    assert twist.linear[0] == pytest.approx(0.2 * (1 - math.exp(-0.02 / 0.04)))


def test_a_pose_older_than_the_last_is_left_out() -> None:
    hand = motion()
    moved(hand, 0.2)
    twist = hand.update(sample((-1, 0, 0), 4 * NS_PER_MS), 9 * NS_PER_MS, 1.0)
    assert twist.linear[0] == pytest.approx(0.2)


def test_poses_at_almost_the_same_time_do_not_make_a_huge_speed() -> None:
    hand = anchored()
    twist = hand.update(sample((0.001, 0, 0), 1000), 1000, 1.0)
    assert twist.linear[0] == pytest.approx(0.5)  # 1 mm over the least interval, 2 ms


def test_a_pose_is_frozen_from_the_limit_on() -> None:
    assert not is_frozen(sample((0, 0, 0), 0), 100 * NS_PER_MS - 1, 100)
    assert is_frozen(sample((0, 0, 0), 0), 100 * NS_PER_MS, 100)


def test_a_pose_that_comes_back_after_anchoring_without_one_moves_nothing() -> None:
    hand = motion()
    lost = sample((0, 0, 0), 0)
    hand.anchor(ControllerSample.released(lost.status, None, 0, 0, 1.0))
    assert hand.update(sample((0.5, 0, 0), 8 * NS_PER_MS), 8 * NS_PER_MS, 1.0).is_zero
    twist = hand.update(sample((0.5016, 0, 0), 16 * NS_PER_MS), 16 * NS_PER_MS, 1.0)
    assert twist.linear[0] == pytest.approx(0.2)
