"""What late and missing poses lead the arm away by is bounded; poor networks pass."""

from __future__ import annotations

import math
from dataclasses import replace
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.config import Config, HandConfig
from tams_app.rotation import Rotation
from tams_app.teleop import motion as of_hand
from tams_app.teleop.motion import Drift, HandMotion
from tams_app.teleop.safety import ArmingState, Reason
from tams_app.units import NS_PER_MS
from tests.teleop.rig import Bench, hand_for, make_config
from tests.teleop.test_motion import sample

pytestmark = pytest.mark.untimed

ENGAGED, HOLDING = ArmingState.ENGAGED, ArmingState.HOLDING
STEP_S = 0.008
X, BACK = (0.2, 0.0, 0.0), (-0.2, 0.0, 0.0)


def drift(limit: float = 0.03, fastest: float = 0.25) -> Drift:
    return Drift(fastest, limit)


def step_of(velocity: tuple[float, float, float]) -> tuple[float, float, float]:
    x, y, z = velocity
    return x * STEP_S, y * STEP_S, z * STEP_S


def test_a_velocity_that_the_hand_had_for_as_long_leads_nowhere() -> None:
    seen = drift()
    for _ in range(500):
        seen.used(X, STEP_S)
        seen.moved(step_of(X), STEP_S)
    assert seen.size < 0.002


def test_motion_that_was_not_used_counts_until_it_is_too_much_and_is_forgotten() -> None:
    seen = drift()
    for _ in range(18):
        seen.moved(step_of(X), STEP_S)
    assert not seen.is_too_large
    seen.moved(step_of(X), STEP_S)
    assert seen.is_too_large
    seen.used((0.0, 0.0, 0.0), 1.0)
    assert seen.size == pytest.approx(19 * 0.2 * STEP_S / math.e)
    seen.clear()
    assert seen.size == 0.0


def test_differences_to_both_sides_cancel_out() -> None:
    seen = drift()
    for velocity in (X, BACK) * 50:
        seen.moved(step_of(velocity), STEP_S)
    assert seen.size < 1e-9


def test_neither_side_counts_for_more_than_the_arm_at_its_fastest() -> None:
    seen = drift(fastest=0.1)
    seen.moved(step_of(X), STEP_S)
    assert seen.size == pytest.approx(0.1 * STEP_S)
    seen.clear()
    seen.used(X, STEP_S)
    assert seen.size == pytest.approx(0.1 * STEP_S)
    seen.clear()
    seen.moved(X, 0.0)  # of two poses at once
    assert seen.size == 0.0


@given(
    hand=st.lists(st.floats(-0.25, 0.25), min_size=50, max_size=200),
    delays=st.lists(st.none() | st.integers(0, 12), min_size=50, max_size=200),
)
@patch.object(of_hand, "SMOOTHING_S", 1e-6)
def test_until_it_is_too_much_the_arm_is_led_away_by_no_more_than_25_mm_and_25_mm_a_second(
    hand: list[float], delays: list[int | None]
) -> None:
    """Whatever is lost or late, and whatever the hand does meanwhile."""
    config = HandConfig(rotation=((1, 0, 0), (0, 1, 0), (0, 0, 1)))
    motion = HandMotion(config, 50 * NS_PER_MS)
    poses, position = [], 0.0
    for speed in hand:
        position += speed * STEP_S
        poses.append(position)
    newest, asked, velocity, pose = -1, 0.0, 0.0, sample((0.0, 0.0, 0.0), 1)
    motion.anchor(pose)
    for tick in range(len(hand) + 12):
        arrived = [
            n
            for n in range(newest + 1, min(tick + 1, len(hand)))
            if (delay := delays[n % len(delays)]) is not None and n + delay <= tick
        ]
        if arrived:
            newest = max(arrived)
            pose = sample((poses[newest], 0.0, 0.0), 1 + (newest + 1) * 8 * NS_PER_MS)
        asked += velocity * STEP_S
        velocity = motion.update(pose, (tick + 1) * 8 * NS_PER_MS, STEP_S).linear[0]
        if motion.is_adrift(turning=False):
            return
        hand_m = poses[newest] if newest >= 0 else 0.0
        assert abs(asked - hand_m) <= 0.025 * (1.0 + (tick + 1) * STEP_S) + 1e-9


@pytest.mark.parametrize("turning", [False, True])
def test_a_hand_that_is_seen_only_while_it_goes_one_way_is_not_followed(turning: bool) -> None:
    """In translation and in orientation mode; what the other mode would have done is no reason."""
    bench = engaged(turning)
    linear = hand_for((0.0, 0.2, 0.0), bench.config)
    seen = bench.hand.sample(bench.now_ns, 0.0)
    for tick in range(360):
        way = 1.0 if tick % 60 < 30 else -1.0
        bench.hand.linear = np.zeros(3) if turning else linear * way
        bench.hand.angular = np.array((0.0, 0.4 * way, 0.0)) if turning else np.zeros(3)
        made = bench.hand.sample(bench.now_ns + 8_333_333, 8_333_333e-9)
        if way > 0 or tick % 7 == 0:
            seen = made
        output = bench.tick(sample=replace(seen, buttons_ns=made.buttons_ns))
        if output.arming is not ArmingState.ENGAGED:
            break
    assert (output.arming, output.reason) == (ArmingState.HOLDING, Reason.HAND_NOT_FOLLOWED)


@pytest.mark.parametrize(("gap_ms", "state"), [(79.95, ENGAGED), (80.05, HOLDING)])
@pytest.mark.parametrize("scale", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("turning", [False, True])
def test_a_gap_in_which_the_arm_could_have_gone_further_than_allowed_holds_it(
    monkeypatch: pytest.MonkeyPatch, turning: bool, scale: float, gap_ms: float, state: ArmingState
) -> None:
    """The hand jumps meanwhile; the arm at its fastest goes 20 mm or turns by 40 mrad in 80 ms."""
    monkeypatch.setattr(of_hand, "MAX_DRIFT_MM", 20.0)
    monkeypatch.setattr(of_hand, "MAX_DRIFT_DEG", math.degrees(0.04))
    config = make_config(hand__translation_scale=scale, hand__rotation_scale=scale)
    bench = engaged(turning, config)
    seen = bench.hand.sample(bench.now_ns, 0.0)
    for _ in range(10):
        bench.tick(sample=replace(seen, buttons_ns=bench.now_ns))
    bench.hand.position = bench.hand.position + np.array([0.1, 0.0, 0.0])
    bench.hand.rotation = Rotation.from_rotvec((0.2, 0.0, 0.0)) * bench.hand.rotation
    after = bench.hand.sample(seen.pose_ns + round(gap_ms * NS_PER_MS), 0.0)
    for _ in range(2):
        output = bench.tick(sample=replace(after, buttons_ns=bench.now_ns))
    assert output.arming is state


def engaged(turning: bool, config: Config | None = None) -> Bench:
    bench = Bench(config)
    bench.engage()
    if turning:
        bench.hand.grip = 1.0
        bench.tick()
        bench.hand.grip = 0.0
        for _ in range(20):
            bench.tick()
    return bench
