import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.sim.operator.hand import (
    PRESS_TRAVEL_S,
    REST_POSITION_M,
    WRIST_REACH_RAD,
    Hand,
    HandCommand,
)

pytestmark = pytest.mark.untimed

REACH_M = 0.18
DT_S = 1 / 120


def _hand() -> Hand:
    return Hand(np.random.default_rng(1), REACH_M)


def _wish(linear=(0, 0, 0), angular=(0, 0, 0), **fingers) -> HandCommand:
    return HandCommand(np.array(linear, dtype=float), np.array(angular, dtype=float), **fingers)


velocities = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


@settings(max_examples=25, deadline=None)
@given(st.lists(st.tuples(velocities, st.integers(5, 80)), min_size=1, max_size=8))
def test_the_hand_never_leaves_its_reach(wishes):
    hand = _hand()
    for velocity, steps in wishes:
        for _ in range(steps):
            hand.step(_wish(velocity, np.multiply(velocity, 5)), DT_S)
            assert np.linalg.norm(hand.arm.offset) <= REACH_M + 1e-12
            assert np.linalg.norm(hand.wrist.offset) <= WRIST_REACH_RAD + 1e-12


def test_a_reach_starts_and_ends_smoothly():
    hand = _hand()
    speeds = []
    for step in range(120):
        hand.step(_wish((0.2 if step < 60 else 0.0, 0, 0)), DT_S)
        speeds.append(hand.arm.velocity[0])
    acceleration = np.abs(np.diff(speeds)) / DT_S
    assert max(speeds) == pytest.approx(0.2, rel=0.05)
    assert acceleration.max() < 3.0
    assert speeds[0] < 0.02
    assert abs(speeds[-1]) < 0.002


def test_a_stalled_caller_gets_nearly_the_same_motion():
    coarse, fine = _hand(), _hand()
    for _ in range(10):
        coarse.step(_wish((0.2, 0, 0)), 0.05)
    for _ in range(50):
        fine.step(_wish((0.2, 0, 0)), 0.01)
    assert coarse.arm.offset == pytest.approx(fine.arm.offset, abs=1e-9)


def test_the_trigger_travels_gradually_both_ways():
    hand = _hand()
    values = []
    for _ in range(12):
        hand.step(_wish(trigger=True), DT_S)
        values.append(hand.trigger)
    assert 0.0 < values[0] < 0.4 < values[5]
    assert hand.trigger == 1.0
    assert sum(value < 1.0 for value in values) * DT_S == pytest.approx(PRESS_TRAVEL_S, abs=0.01)
    hand.step(_wish(), DT_S)
    assert 0.6 < hand.trigger < 1.0


def test_a_still_hand_trembles_a_little_and_stays():
    hand = _hand()
    poses = []
    for _ in range(600):
        hand.step(HandCommand.still(), DT_S)
        poses.append(hand.pose())
    offset = np.array(poses)[:, :3] - REST_POSITION_M
    assert 1e-5 < offset.std() < 3e-4
    assert np.abs(offset.mean(axis=0)).max() < 2e-5


def _path(motor_noise: float, tremor: float = 1.0, speed: float = 0.2) -> np.ndarray:
    hand = Hand(np.random.default_rng(4), 2.0, tremor, motor_noise)
    wish = HandCommand(np.array([speed, 0.0, 0.0]), np.zeros(3))
    poses = []
    for _ in range(240):
        hand.step(wish, 1 / 120)
        poses.append(hand.pose()[:3])
    return np.array(poses)


def test_motor_noise_grows_with_speed_and_leaves_a_hand_at_rest_alone():
    steady, noisy = _path(0.0), _path(0.1)
    slow_off = np.abs(_path(0.1, speed=0.02) - _path(0.0, speed=0.02)).max()
    assert np.abs(noisy - steady).max() > 5.0 * slow_off > 0.0
    assert (_path(0.1, speed=0.0) == _path(0.0, speed=0.0)).all()


def test_tremor_is_as_large_as_the_person_s():
    calm, shaky = (_path(0.0, tremor, speed=0.0).std(axis=0) for tremor in (1.0, 2.0))
    assert shaky == pytest.approx(2.0 * calm)
    assert 3e-5 < calm.mean() < 8e-5
