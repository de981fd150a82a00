"""Queued joint moves: profile, order, interruption."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from hw.sim.controller.joint_moves import MAX_QUEUED_MOVES, JointMove, MoveQueue
from hw.sim.controller.joint_servo import CYCLE_S, MAX_JOINT_ACCELERATION, CommandError
from tams_app.records import Vector

pytestmark = pytest.mark.untimed

START = np.zeros(6)
GOAL = np.array([0.5, -0.2, 1.0, 0.0, 0.3, -0.8])


def run(queue: MoveQueue, joints: Vector, cycles: int = 10_000) -> list[Vector]:
    """The joints of every cycle until the queue has nothing more to do."""
    path = [joints]
    for _ in range(cycles):
        following = queue.step(path[-1])
        if following is None:
            break
        path.append(following)
    return path


@given(st.floats(0.01, 2.0), st.floats(0.5, 10.0), st.floats(1.0, 40.0))
@settings(deadline=None, max_examples=30)
def test_a_move_keeps_to_speed_and_acceleration_and_ends_at_its_goal(
    way: float, speed: float, acceleration: float
) -> None:
    queue = MoveQueue()
    queue.command(np.array([0.0, way, 0, 0, 0, 0]), speed, acceleration)
    path = np.array(run(queue, START))[:, 1]
    velocity = np.diff(path, prepend=path[0], append=path[-1]) / CYCLE_S
    assert path[-1] == way
    assert velocity.max() <= min(speed, math.pi) + 1e-9
    assert velocity.min() >= 0.0
    allowed = min(acceleration, MAX_JOINT_ACCELERATION)
    assert np.abs(np.diff(velocity)).max() <= allowed * CYCLE_S * (1 + 1e-6)


def test_all_joints_arrive_together_on_a_straight_line() -> None:
    queue = MoveQueue()
    queue.command(GOAL, 1.0, 5.0)
    path = np.array(run(queue, START))
    fraction = path[:, 2]
    np.testing.assert_allclose(path, fraction[:, None] * GOAL, atol=1e-12)
    np.testing.assert_array_equal(path[-1], GOAL)


def test_a_move_takes_the_time_of_its_trapezoid() -> None:
    assert JointMove(START, GOAL, 0.5, 5.0).duration_s == pytest.approx(1.0 / 0.5 + 0.5 / 5.0)


def test_a_move_to_where_the_joints_are_is_done_at_once() -> None:
    queue = MoveQueue()
    queue.command(START, 1.0, 1.0)
    assert len(run(queue, START)) == 2
    assert len(queue) == 0


def test_moves_run_in_order_and_are_counted() -> None:
    queue = MoveQueue()
    queue.command(GOAL, 3.0, 20.0)
    queue.command(START, 3.0, 20.0)
    assert len(queue) == 2
    path = run(queue, START)
    assert any((joints == GOAL).all() for joints in path)
    np.testing.assert_array_equal(path[-1], START)
    assert len(queue) == 0


def test_an_infinite_angle_leaves_its_joint_alone() -> None:
    queue = MoveQueue()
    queue.command(np.array([0.2, *[math.inf] * 5]), 1.0, 5.0)
    np.testing.assert_array_equal(run(queue, GOAL)[-1], [0.2, *GOAL[1:]])


def test_an_interrupted_move_goes_on_from_where_the_joints_came_to() -> None:
    queue = MoveQueue()
    queue.command(GOAL, 1.0, 5.0)
    queue.command(START, 1.0, 5.0)
    halfway = run(queue, START, cycles=100)[-1]
    queue.interrupt()
    assert len(queue) == 2
    elsewhere = np.add(halfway, 0.01)
    path = run(queue, elsewhere)
    assert np.abs(np.subtract(path[1], elsewhere)).max() < 0.001
    assert any(np.array_equal(joints, GOAL) for joints in path)
    np.testing.assert_array_equal(path[-1], START)


def test_a_full_queue_refuses_more() -> None:
    queue = MoveQueue()
    for _ in range(MAX_QUEUED_MOVES):
        queue.command(GOAL, 1.0, 5.0)
    with pytest.raises(CommandError):
        queue.command(GOAL, 1.0, 5.0)
