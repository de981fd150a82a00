import math
from dataclasses import replace

import numpy as np
import pytest

from hw.sim.operator.hand import ThumbButton
from hw.sim.operator.participant import ParticipantProfile
from hw.sim.operator.servoing import GapSigmas, Percept, ViewSight
from hw.sim.operator.task import Intent, PickAndPlace, Stage
from tams_app.config import OperatorConfig
from tams_app.records import Pose
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_MS

pytestmark = pytest.mark.untimed

DOWN = Rotation.from_matrix([[1, 0, 0], [0, -1, 0], [0, 0, -1]])
STEP_NS = 10 * NS_PER_MS


SCRIPTED = ParticipantProfile.scripted(
    OperatorConfig(reach_speed_m_s=0.2, fine_speed_m_s=0.06, reaction_s=0.1)
)


def _task(**traits: float) -> PickAndPlace:
    return PickAndPlace(replace(SCRIPTED, **traits), 1.0, np.random.default_rng(0))


def _percept(tcp=(0.35, 0.0, 0.18), block=(0.33, -0.1, 0.01), opening=0.016) -> Percept:
    return Percept(
        0,
        Pose(np.array(tcp), DOWN),
        Pose(np.array(block), Rotation.identity()),
        Pose(np.array([0.33, 0.15, 0.0]), Rotation.identity()),
        opening,
    )


def _uncertain(sigma: float) -> Percept:
    return replace(_percept(), gaps=GapSigmas(sigma, sigma, sigma))


def _step(task: PickAndPlace, percept: Percept, now_ns: int = 0) -> Intent:
    return task.step(now_ns, ViewSight(percept, np.zeros(3), np.zeros(3)))


def _run(task: PickAndPlace, percept: Percept, start_ns: int, seconds: float) -> list[Intent]:
    steps = round(seconds * 100)
    return [_step(task, percept, start_ns + step * STEP_NS) for step in range(steps)]


def test_reaching_keeps_the_height_so_that_only_a_descent_goes_down():
    intent = _step(_task(), _percept())
    assert intent.linear[2] == 0.0
    assert np.linalg.norm(intent.linear) == pytest.approx(0.2)
    assert intent.turning is False


def test_a_low_gripper_rises_before_it_travels():
    intent = _step(_task(), _percept(tcp=(0.35, 0.0, 0.05)))
    assert intent.linear[2] > 0.0
    assert not intent.linear[:2].any()


def test_a_block_out_of_sight_is_waited_for():
    unseen, unsure = _uncertain(math.inf), _uncertain(0.03)
    assert not any(intent.linear.any() for intent in _run(_task(), unseen, 0, 1.0))
    assert 0.0 < np.linalg.norm(_step(_task(), unsure).linear) < 0.15


def test_closed_fingers_are_opened_before_anything_else():
    task = _task()
    intents = _run(task, _percept(opening=0.0), 0, 0.2)
    assert task.stage is Stage.OPEN
    assert intents[-1].button is ThumbButton.B


def test_a_descent_stops_while_the_gripper_is_beside_the_block():
    task = _task()
    task.stage = Stage.DESCEND
    intent = _step(task, _percept(tcp=(0.33, -0.08, 0.04)))
    assert intent.linear[2] == 0.0
    assert intent.linear[1] < 0.0
    assert _step(task, _percept(tcp=(0.33, -0.1, 0.04))).linear[2] < -0.015


def test_after_the_wait_limit_the_operator_goes_on_slowly():
    steady = _task()
    hasty = _task(wait_limit_s=1.5)
    for task, moves in ((steady, False), (hasty, True)):
        intents = _run(task, _uncertain(0.05), 0, 2.0)
        assert not any(intent.linear.any() for intent in intents[:140])
        assert bool(intents[-1].linear.any()) is moves
    assert np.linalg.norm(intents[-1].linear) < 0.3 * 0.2


def test_with_nothing_to_go_by_the_operator_waits_longer_but_not_for_ever():
    hasty = _task(wait_limit_s=0.5)
    intents = _run(hasty, _uncertain(0.5), 0, 3.0)
    moving = [intent.linear.any() for intent in intents]
    assert not any(moving[: len(moving) * 2 // 3])
    assert moving[-1]
    assert np.linalg.norm(intents[-1].linear) < 0.3 * 0.2


def test_a_view_that_clears_resets_the_wait():
    hasty = _task(wait_limit_s=1.0)
    assert _run(hasty, _uncertain(0.05), 0, 1.5)[-1].linear.any()
    _run(hasty, _uncertain(0.001), 1_500_000_000, 0.1)
    assert not _run(hasty, _uncertain(0.05), 1_600_000_000, 0.5)[-1].linear.any()
