from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial import transform

from tams_app.rotation import Rotation

pytestmark = pytest.mark.untimed

vectors = st.lists(st.floats(-1.8, 1.8), min_size=3, max_size=3).map(np.array)
near_half_a_turn = st.tuples(
    vectors.filter(lambda drawn: np.linalg.norm(drawn) > 1e-6), st.floats(-1e-3, 1e-3)
).map(lambda drawn: drawn[0] * (math.pi + drawn[1]) / np.linalg.norm(drawn[0]))
turns = st.one_of(vectors, near_half_a_turn)


def theirs(rotation: Rotation) -> transform.Rotation:
    return transform.Rotation.from_quat(rotation)


def off(ours: Rotation, expected: transform.Rotation) -> float:
    """The angle [rad] between the two."""
    return float((theirs(ours) * expected.inv()).magnitude())


@given(turns, turns, vectors)
def test_every_operation_agrees_with_scipy(
    first: np.ndarray, second: np.ndarray, point: np.ndarray
) -> None:
    a, b = transform.Rotation.from_rotvec(first), transform.Rotation.from_rotvec(second)
    ours_a, ours_b = Rotation.from_rotvec(first), Rotation.from_rotvec(second)
    assert off(ours_a, a) < 1e-7
    assert off(Rotation.from_quat(2.5 * a.as_quat()), a) < 1e-7
    assert off(Rotation.from_matrix(a.as_matrix()), a) < 1e-7
    assert off(ours_b * ours_a, b * a) < 1e-7
    assert off(ours_a.turned(second), b * a) < 1e-7
    assert off(ours_a.inv(), a.inv()) < 1e-7
    assert ours_a.magnitude() == pytest.approx(a.magnitude(), abs=1e-12)
    np.testing.assert_allclose(ours_a.as_matrix(), a.as_matrix(), atol=1e-12)
    np.testing.assert_allclose(ours_a.apply(point), a.apply(point), atol=1e-12)
    np.testing.assert_allclose(ours_a.apply([point, first]), a.apply([point, first]), atol=1e-12)


@given(turns)
def test_rotation_vectors_are_at_most_half_a_turn_and_lead_to_the_same_place(
    vector: np.ndarray,
) -> None:
    rotation = Rotation.from_rotvec(vector)
    again = rotation.as_rotvec()
    assert np.linalg.norm(again) <= math.pi + 1e-12
    assert off(Rotation.from_rotvec(again), theirs(rotation)) < 1e-7


@given(turns, turns)
def test_turning_by_the_turn_to_the_end_leads_there(first: np.ndarray, second: np.ndarray) -> None:
    a, b = Rotation.from_rotvec(first), Rotation.from_rotvec(second)
    turn = a.turn_to(b)
    assert np.linalg.norm(turn) <= math.pi + 1e-9
    assert off(a.turned(turn), theirs(b)) < 1e-7


@pytest.mark.parametrize("size", [0.0, 1e-15, 1e-10, 1e-6, 1e-3, 3.0])
def test_small_turns_keep_their_precision(size: float) -> None:
    start = Rotation.from_rotvec((0.1, 0.2, 0.3))
    turn = size * np.array([0.6, 0.0, 0.8])
    np.testing.assert_allclose(start.turn_to(start.turned(turn)), turn, atol=3e-16 + 1e-9 * size)


def test_the_turn_to_the_end_is_the_short_way_round() -> None:
    start, end = Rotation.from_rotvec((0, 0, 3.0)), Rotation.from_rotvec((0, 0, -3.0))
    short = 2 * math.pi - 6.0
    np.testing.assert_allclose(start.turn_to(end), [0, 0, short], atol=1e-9)
    np.testing.assert_allclose(end.turn_to(start), [0, 0, -short], atol=1e-9)


@pytest.mark.parametrize("axis", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (0.6, 0.64, -0.48)])
def test_half_turns_come_back_from_their_matrices(axis: tuple[float, float, float]) -> None:
    half = Rotation.from_rotvec(math.pi * np.array(axis))
    assert off(Rotation.from_matrix(half.as_matrix()), theirs(half)) < 1e-7


def test_a_chain_of_turns_stays_a_rotation() -> None:
    rotation, turn = Rotation.identity(), Rotation.from_rotvec((0.3, -0.2, 0.1))
    for _ in range(10_000):
        rotation = turn * rotation
    assert math.hypot(*rotation) == pytest.approx(1.0, abs=1e-15)


def test_a_quaternion_without_length_is_refused() -> None:
    with pytest.raises(ValueError, match="length 0"):
        Rotation.from_quat((0.0, 0.0, 0.0, 0.0))


def test_a_rotation_is_not_changed_afterwards() -> None:
    with pytest.raises(AttributeError):
        Rotation.identity().x = 1.0  # type: ignore[misc]
