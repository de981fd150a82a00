from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tams_app.teleop.quaternion import (
    inverse,
    of_rotation,
    product,
    to_rotation,
    turn_between,
    turned,
)

pytestmark = pytest.mark.waiting

vectors = st.lists(st.floats(-1.8, 1.8), min_size=3, max_size=3).map(np.array)


@given(vectors, vectors)
def test_products_and_turns_agree_with_scipy(first: np.ndarray, second: np.ndarray) -> None:
    a, b = Rotation.from_rotvec(first), Rotation.from_rotvec(second)
    ours = to_rotation(product(of_rotation(b), of_rotation(a)))
    assert (ours * (b * a).inv()).magnitude() < 1e-7
    assert (to_rotation(turned(of_rotation(a), second)) * (b * a).inv()).magnitude() < 1e-7
    back = product(of_rotation(a), inverse(of_rotation(a)))
    assert to_rotation(back).magnitude() < 1e-7


@given(vectors, vectors)
def test_turning_by_the_turn_between_leads_there(first: np.ndarray, second: np.ndarray) -> None:
    a, b = of_rotation(Rotation.from_rotvec(first)), of_rotation(Rotation.from_rotvec(second))
    turn = turn_between(a, b)
    assert np.linalg.norm(turn) <= np.pi + 1e-9
    assert (to_rotation(turned(a, turn)) * to_rotation(b).inv()).magnitude() < 1e-7


@pytest.mark.parametrize("size", [0.0, 1e-15, 1e-10, 1e-6, 1e-3, 3.0])
def test_small_turns_keep_their_precision(size: float) -> None:
    start = of_rotation(Rotation.from_euler("xyz", [10, 20, 30], degrees=True))
    turn = size * np.array([0.6, 0.0, 0.8])
    np.testing.assert_allclose(
        turn_between(start, turned(start, turn)), turn, atol=3e-16 + 1e-9 * size
    )


def test_the_turn_between_is_the_short_way_round() -> None:
    start = of_rotation(Rotation.from_rotvec([0, 0, 3.0]))
    end = of_rotation(Rotation.from_rotvec([0, 0, -3.0]))
    short = 2 * np.pi - 6.0
    np.testing.assert_allclose(turn_between(start, end), [0, 0, short], atol=1e-9)
    np.testing.assert_allclose(turn_between(end, start), [0, 0, -short], atol=1e-9)
