"""The rules of a trial."""

import numpy as np
import pytest

from tams_app.config import TrialConfig
from tams_app.records import Pose, SceneTruth
from tams_app.rotation import Rotation
from tams_app.task.judge import TaskGeometry, TrialJudge

pytestmark = pytest.mark.untimed

S = 1_000_000_000
GEOMETRY = TaskGeometry(container_inner=0.09, container_height=0.03, block_rest_height=0.01)
CONTAINER = np.array([0.30, 0.20, 0.0])


def truth(t_s, block, speed=0.0):
    upright = Rotation.identity()
    return SceneTruth(
        t_ns=round(t_s * S),
        block=Pose(np.array(block, dtype=float), upright),
        container=Pose(CONTAINER, Rotation.from_rotvec((0, 0, np.radians(20)))),
        tcp=Pose(np.zeros(3), upright),
        block_speed=speed,
        fingers_opening=0.016,
    )


ON_TABLE = (0.35, -0.10, 0.010)
LIFTED = (0.35, -0.10, 0.080)
OVER_CONTAINER = (0.30, 0.20, 0.060)
IN_CONTAINER = (0.31, 0.19, 0.013)


def play(judge, story):
    """story: (seconds from the first engagement, block, closed[, speed])."""
    judge.engaged(0)
    ended = False
    for t_s, block, closed, *speed in story:
        ended = judge.step(round(t_s * S), truth(t_s, block, *speed), closed)
    return ended


def judge(**config):
    return TrialJudge(TrialConfig(**config), GEOMETRY)


CARRY = [(1, ON_TABLE, False), (5, ON_TABLE, True), (6, LIFTED, True), (9, OVER_CONTAINER, True)]
PLACE = [(10, OVER_CONTAINER, False, 0.2), (10.2, IN_CONTAINER, False), (10.8, IN_CONTAINER, False)]


def test_a_placed_block_completes_the_trial_at_the_opening_that_led_to_it():
    trial = judge()
    assert play(trial, CARRY + PLACE)
    outcome = trial.outcome()
    assert outcome.completed
    assert outcome.success
    assert outcome.completion_time_s == pytest.approx(10.0)
    assert outcome.drops == 0


def test_a_block_that_has_not_rested_half_a_second_is_not_placed():
    trial = judge()
    assert not play(trial, CARRY + PLACE[:2])
    assert not trial.outcome().completed
    assert trial.outcome().completion_time_s is None


@pytest.mark.parametrize(("closed", "speed"), [(False, 0.02), (True, 0.0)])
def test_a_block_that_moves_or_is_held_is_not_placed(closed, speed):
    trial = judge()
    assert not play(trial, CARRY + [(10 + i, IN_CONTAINER, closed, speed) for i in range(5)])


@pytest.mark.parametrize(
    ("story", "drops"),
    [
        ([*CARRY[:3], (7, ON_TABLE, True), (8, ON_TABLE, True)], 1),  # out of the closed gripper
        ([*CARRY[:3], (7, LIFTED, False), (8, ON_TABLE, False), (9, ON_TABLE, True)], 1),
        ([(1, ON_TABLE, True), (2, ON_TABLE, False), (3, ON_TABLE, True)], 0),  # never lifted
    ],
)
def test_a_lifted_block_that_slips_or_is_let_go_outside_the_container_is_one_drop(story, drops):
    trial = judge()
    play(trial, story)
    assert trial.drops == drops


@pytest.mark.parametrize(
    ("story", "drops"),
    [
        ([(0.1, LIFTED, True), (0.2, ON_TABLE, True)] * 3 + CARRY + PLACE, 3),
        ([(t + 85, *rest) for t, *rest in CARRY + PLACE], 0),
    ],
)
def test_more_than_two_drops_or_ninety_seconds_complete_but_do_not_succeed(story, drops):
    trial = judge()
    assert play(trial, story)
    outcome = trial.outcome()
    assert (outcome.completed, outcome.success, outcome.drops) == (True, False, drops)


def test_the_trial_ends_at_the_limit_without_a_placement():
    trial = judge()
    assert not play(trial, [(119.9, ON_TABLE, False)])
    assert trial.step(120 * S, truth(120, ON_TABLE), False)
    assert trial.outcome().reason == "not placed in time"


def test_without_a_limit_a_trial_goes_on_until_the_block_is_placed():
    trial = judge()
    trial.engaged(0)
    assert not trial.step(500 * S, truth(500, ON_TABLE), False, limited=False)
    for t_s, block, closed, *speed in CARRY + PLACE:
        at_s = t_s + 500
        ended = trial.step(round(at_s * S), truth(at_s, block, *speed), closed, limited=False)
    assert ended
    assert (trial.outcome().completed, trial.outcome().success) == (True, True)


def test_the_clock_starts_at_the_first_engagement_and_only_there():
    trial = judge()
    assert not trial.step(500 * S, truth(500, ON_TABLE), False)
    trial.engaged(600 * S)
    trial.engaged(700 * S)
    assert trial.elapsed_s(610 * S) == pytest.approx(10)


@pytest.mark.parametrize("offset", [(0.044, 0, 0), (0, -0.044, 0)])
def test_the_container_is_measured_in_its_own_frame(offset):
    turned = Rotation.from_rotvec((0, 0, np.radians(20)))
    scene = truth(0, CONTAINER + turned.apply(offset))
    assert judge().contains(scene.container, scene.block)
    scene = truth(0, CONTAINER + turned.apply(np.array(offset) * 1.05))
    assert not judge().contains(scene.container, scene.block)
