from __future__ import annotations

import numpy as np
import pytest

from tams_app.config import LimitsConfig
from tams_app.records import Twist
from tams_app.rotation import Rotation
from tams_app.teleop.servo import Target, Tcp, TcpPredictor

pytestmark = pytest.mark.waiting

MS = 1_000_000
IDENTITY = Rotation.identity()
HERE = Tcp((0.3, 0.0, 0.2), IDENTITY)


def at(x: float, turn: float = 0.0) -> Tcp:
    return Tcp((0.3 + x, 0.0, 0.2), IDENTITY.turned((0, 0, turn)))


def predictor_after(ticks: int) -> TcpPredictor:
    """0.1 m/s and 1 rad/s over `ticks` of 10 ms, from t = 0."""
    predictor = TcpPredictor()
    twist = Twist(np.array([0.1, 0, 0]), np.array([0, 0, 1.0]))
    for tick in range(1, ticks + 1):
        predictor.sent(twist, tick * 10 * MS, 0.01)
    return predictor


@pytest.fixture
def target() -> Target:
    """One that is anchored `HERE`."""
    target = Target(LimitsConfig())
    target.anchor(HERE)
    return target


@pytest.mark.parametrize(
    ("received_ms", "delay_ms", "unseen_ms"), [(100, 0, 0), (80, 0, 20), (85, 0, 15), (80, 12, 32)]
)
def test_the_predicted_tcp_is_the_report_and_what_was_sent_since(
    received_ms: int, delay_ms: int, unseen_ms: int
) -> None:
    now = predictor_after(10).predict(HERE, received_ms * MS, delay_ms * MS)
    assert now.position[0] == pytest.approx(0.3 + 0.1 * unseen_ms / 1000)
    assert IDENTITY.turn_to(now.rotation)[2] == pytest.approx(unseen_ms / 1000)


def test_a_report_older_than_memory_counts_all_that_is_remembered() -> None:
    now = predictor_after(200).predict(HERE, 0, 0)
    assert now.position[0] == pytest.approx(0.35, abs=0.0011)


def test_nothing_sent_means_the_report_is_the_prediction() -> None:
    now = TcpPredictor().predict(HERE, 0, 0)
    assert now == HERE


def test_the_target_integrates_velocity_and_rotation(target: Target) -> None:
    for _ in range(10):
        target.advance(np.array([0.1, 0, 0]), np.array([0, 0, 0.5]), 0.01)
    assert target.tcp.position[0] == pytest.approx(0.31)
    assert IDENTITY.turn_to(target.tcp.rotation)[2] == pytest.approx(0.05)


def test_the_target_never_gets_further_from_the_arm_than_its_leash(target: Target) -> None:
    target.advance(np.array([1.0, 0, 0]), np.array([0, 0, 10.0]), 0.02)
    target.pull_back(HERE)
    assert target.tcp.position[0] == pytest.approx(0.315)
    assert IDENTITY.turn_to(target.tcp.rotation)[2] == pytest.approx(0.05)


def test_a_target_within_its_leash_is_left_alone(target: Target) -> None:
    target.advance(np.array([0.0149, 0, 0]), np.array([0, 0, 0.0499]), 1.0)
    before = target.tcp
    target.pull_back(HERE)
    assert target.tcp == before


@pytest.mark.parametrize(
    ("linear", "angular", "asked_at_most"), [(0.1, 0.0, 0.061), (0.0, 0.5, 0.201)]
)
def test_an_arm_that_does_not_follow_is_out_of_reach_although_the_target_waits(
    target: Target, linear: float, angular: float, asked_at_most: float
) -> None:
    asked = 0.0
    while not target.is_out_of_reach:
        target.advance((linear, 0, 0), (0, 0, angular), 0.01)
        asked += (linear + angular) * 0.01
        target.pull_back(HERE)
        target.watch(HERE)
        assert asked < 1.0
    assert asked == pytest.approx(asked_at_most, rel=0.02)


@pytest.mark.parametrize(("way", "turn"), [(0.05, 0.0), (0.0, 0.15)])
def test_an_arm_that_catches_up_is_forgiven(target: Target, way: float, turn: float) -> None:
    for _ in range(3):
        behind = target.tcp
        target.advance((way, 0, 0), (0, 0, turn), 1.0)
        target.pull_back(behind)
        for _ in range(10):
            target.pull_back(target.tcp)
        target.watch(target.tcp)
        assert not target.is_out_of_reach


@pytest.mark.parametrize(
    ("distance", "kept_back"), [(0.0126, 0.055), (0.0144, 0.055), (0.0146, 0.0546), (0.0037, 0.0)]
)
def test_what_was_kept_back_is_forgiven_once_the_arm_is_nearly_where_it_should_be(
    distance: float, kept_back: float
) -> None:
    target = Target(LimitsConfig())
    target.anchor(Tcp((0.0, 0.0, 0.0), IDENTITY))
    target.advance((0.07, 0, 0), (0, 0, 0), 1.0)
    target.pull_back(Tcp((0.0, 0.0, 0.0), IDENTITY))  # 55 mm are kept back
    near = Tcp((0.015 - distance, 0.0, 0.0), IDENTITY)
    target.pull_back(near)
    target.watch(Tcp((0.015 - (0.0599 - kept_back), 0.0, 0.0), IDENTITY))
    assert not target.is_out_of_reach
    target.watch(Tcp((0.015 - (0.0601 - kept_back), 0.0, 0.0), IDENTITY))
    assert target.is_out_of_reach


def test_an_arm_at_its_target_is_forgiven_what_was_kept_back_when_it_is_anchored_anew(
    target: Target,
) -> None:
    target.advance((0.07, 0, 0), (0, 0, 0.4), 1.0)
    target.pull_back(HERE)
    target.watch(HERE)
    assert target.is_out_of_reach
    target.anchor(HERE)
    assert not target.is_out_of_reach
    target.watch(HERE)
    assert not target.is_out_of_reach


@pytest.mark.parametrize(
    ("within", "beyond"), [((0.05999, 0), (0.06001, 0)), ((0, 0.19999), (0, 0.20001))]
)
def test_an_arm_that_jumps_or_turns_away_is_out_of_reach_at_once(
    target: Target, within: tuple[float, float], beyond: tuple[float, float]
) -> None:
    target.watch(at(*within))
    assert not target.is_out_of_reach
    target.watch(at(*beyond))
    assert target.is_out_of_reach
