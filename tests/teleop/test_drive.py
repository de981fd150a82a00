"""How the engaged hand moves the arm: clutch, target and limits."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from tams_app.teleop import drive as drive_module
from tams_app.teleop.safety import ArmingState, Reason
from tams_app.teleop.trajectory import TrajectoryError
from tams_app.vectors import norm
from tests.teleop.rig import (
    PERIOD_NS,
    READY_POSITION,
    READY_ROTATION,
    Bench,
    IntegratingArm,
    RoomyModel,
)

pytestmark = pytest.mark.waiting

DISARMED, READY, ENGAGED, HOLDING, FAULT = ArmingState
MS = 1_000_000


@pytest.fixture
def bench() -> Bench:
    return Bench()


@pytest.fixture
def engaged(bench: Bench) -> Bench:
    bench.engage()
    return bench


# --- clutch ---------------------------------------------------------------------------------------


def test_the_arm_follows_the_hand_by_the_mapped_displacement(engaged: Bench) -> None:
    engaged.ask(0.0, 0.1, 0.05)
    engaged.run(60)
    engaged.ask(0, 0, 0)
    engaged.run(120)
    asked = np.array([0.0, 0.1, 0.05]) * 60 * PERIOD_NS / 1e9
    np.testing.assert_allclose(engaged.arm.pose.position - READY_POSITION, asked, atol=2e-3)


def test_reengaging_after_a_release_does_not_jump(engaged: Bench) -> None:
    engaged.ask(0.0, 0.15, 0.0)
    engaged.run(60)
    engaged.hand.trigger = 0.0
    engaged.run(40)  # the hand goes on while the clutch is open
    resting = engaged.arm.pose.position.copy()
    engaged.ask(0, 0, 0)
    engaged.hand.trigger = 1.0
    assert engaged.tick().arming is ENGAGED
    engaged.run(60)
    np.testing.assert_allclose(engaged.arm.pose.position, resting, atol=1e-9)


def test_reengaging_where_the_arm_was_moved_to_meanwhile_does_not_jump(engaged: Bench) -> None:
    engaged.hand.trigger = 0.0
    engaged.run(3)
    engaged.arm.pose = replace(engaged.arm.pose, position=np.array([0.36, 0.1, 0.2]))
    engaged.hand.trigger = 1.0
    engaged.run(60)
    np.testing.assert_allclose(engaged.arm.pose.position, [0.36, 0.1, 0.2], atol=1e-9)


def test_reengaging_at_once_stops_first_and_then_follows(engaged: Bench) -> None:
    engaged.ask(0.0, 0.15, 0.0)
    engaged.run(60)
    engaged.hand.trigger = 0.0
    engaged.run(2)
    engaged.hand.trigger = 1.0
    engaged.tick()
    engaged.run(14)
    assert (engaged.linear()[-15:] == 0).all(axis=1).any()
    engaged.run(60)
    assert engaged.linear()[-1][1] == pytest.approx(0.15, rel=0.05)


def test_after_a_release_the_twist_is_exactly_zero_within_100_ms_and_stays(
    engaged: Bench,
) -> None:
    engaged.ask(0.1, 0.25, 0.1)
    engaged.run(40)
    assert np.linalg.norm(engaged.linear()[-1]) > 0.2
    engaged.hand.trigger = 0.0
    released = len(engaged.outputs)
    engaged.run(80)
    assert not engaged.linear()[released + 12 :].any()


def test_grip_switches_between_translation_and_orientation(engaged: Bench) -> None:
    engaged.ask(0.0, 0.1, 0.0)
    engaged.ask_turn(0.0, 0.2, 0.0)
    engaged.run(60)
    assert not engaged.angular().any()
    engaged.hand.grip = 1.0
    assert engaged.tick().orientation_mode
    engaged.run(13)
    engaged.hand.grip = 0.0
    switched = len(engaged.outputs)
    engaged.run(60)
    assert not engaged.linear()[switched:].any()
    assert engaged.angular()[-1][1] == pytest.approx(0.2, rel=0.1)
    engaged.tick(estop=True)
    assert not engaged.tick().orientation_mode


# --- target and limits ---


def test_an_arm_that_is_stuck_is_pushed_no_harder_than_the_leash_allows(engaged: Bench) -> None:
    stuck = engaged.arm.report(engaged.now_ns)
    engaged.ask(0, 0.1, 0)
    for _ in range(48):
        engaged.tick(arm=replace(stuck, received_ns=engaged.now_ns + PERIOD_NS))
    assert engaged.outputs[-1].arming is ENGAGED
    assert 0.13 < engaged.linear()[-1][1] < 0.1 + 4.0 * 0.015 + 0.005


def test_an_arm_that_drifts_is_brought_back_to_the_target(engaged: Bench) -> None:
    engaged.run(5)
    pose = engaged.arm.pose
    engaged.arm.pose = replace(pose, position=pose.position + np.array([0, 0.01, 0]))
    engaged.run(240)
    # The target gives way by what the arm cannot make up at once within its jerk.
    np.testing.assert_allclose(engaged.arm.pose.position, READY_POSITION, atol=2e-3)


def test_an_arm_that_turns_by_itself_is_turned_back_to_the_target(engaged: Bench) -> None:
    engaged.hand.grip = 1.0
    engaged.run(20)
    engaged.arm.pose = replace(engaged.arm.pose, rotation=READY_ROTATION.turned((0.0, 0.04, 0.0)))
    engaged.run(240)
    left = norm(READY_ROTATION.turn_to(engaged.arm.pose.rotation))
    assert left < 0.01


class SingularModel(RoomyModel):
    def jacobian(self, joints: np.ndarray) -> np.ndarray:
        return np.zeros((6, 6))


def test_a_singular_posture_holds_and_names_it() -> None:
    bench = Bench(model=SingularModel())
    bench.engage()
    bench.ask(0, 0.1, 0)
    bench.run(60)
    assert bench.outputs[-1].reason is Reason.SINGULARITY
    assert not bench.linear().any()


def test_a_limit_that_comes_and_goes_holds_the_arm_only_once_it_stays_for_300_ms() -> None:
    class Posture(RoomyModel):
        is_singular = False

        def jacobian(self, joints: np.ndarray) -> np.ndarray:
            return np.zeros((6, 6)) if self.is_singular else np.eye(6)

    model = Posture()
    bench = Bench(model=model)
    bench.engage()
    bench.ask(0, 0.1, 0)
    for singular, ticks in ((False, 50), (True, 25), (False, 5), (True, 29)):
        model.is_singular = singular
        assert bench.run(ticks, period_ns=10 * MS).arming is ENGAGED
    states = [bench.tick(period_ns=10 * MS).arming for _ in range(5)]
    assert states[-1] is HOLDING


def test_a_trajectory_that_cannot_be_computed_is_a_fault_and_a_stop(
    engaged: Bench, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(*_: object) -> None:
        raise TrajectoryError("no way")

    engaged.ask(0, 0.2, 0)
    engaged.run(20)
    monkeypatch.setattr(drive_module.Limits, "shape", fail)
    output = engaged.tick()
    assert (output.arming, output.reason, output.stop) == (FAULT, Reason.TRAJECTORY_ERROR, True)
    assert output.twist is not None
    assert output.twist.is_zero


@pytest.mark.parametrize("delay_ticks", [0, 1, 3])
def test_an_arm_that_follows_late_hardly_overshoots_when_the_hand_stops(delay_ticks: int) -> None:
    bench = Bench(arm=IntegratingArm(delay_ticks=delay_ticks))
    bench.engage()
    bench.ask(0, 0.25, 0)
    bench.run(60)
    bench.ask(0, 0, 0)
    bench.run(180)
    reached = bench.path()[:, 1]
    assert reached.max() - reached[-1] < 0.004


def test_pushing_against_the_floor_holds_and_names_the_workspace(engaged: Bench) -> None:
    engaged.ask(0, 0, -0.3)
    engaged.run(360)
    assert (engaged.outputs[-1].arming, engaged.outputs[-1].reason) == (HOLDING, Reason.WORKSPACE)
    assert 0.005 <= engaged.path()[:, 2].min() < 0.007
    engaged.hand.trigger = 0.0
    assert engaged.tick().arming is READY


def test_a_rotation_of_the_ready_pose_is_the_axis_of_the_cone() -> None:
    tilted = READY_ROTATION.turned((0.0, np.radians(30), 0.0))
    bench = Bench()
    bench.arm.pose = replace(bench.arm.pose, rotation=tilted)
    bench.engage()
    bench.hand.grip = 1.0
    bench.tick()
    bench.ask_turn(0, 0.5, 0)
    bench.run(200)
    angle = (bench.arm.pose.rotation * READY_ROTATION.inv()).magnitude()
    assert math.radians(33) < angle <= math.radians(35)
