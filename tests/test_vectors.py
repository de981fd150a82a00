from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app import vectors
from tams_app.vectors import Floats3

pytestmark = pytest.mark.untimed

numbers = st.floats(-100.0, 100.0)
triples = st.tuples(numbers, numbers, numbers)


@given(triples, triples, numbers)
def test_every_operation_agrees_with_numpy(a: Floats3, b: Floats3, factor: float) -> None:
    one, other = np.array(a), np.array(b)
    for ours, theirs in (
        (vectors.floats(one), one),
        (vectors.plain(one), one),
        (vectors.plain(a), one),
        (vectors.plus(a, b), one + other),
        (vectors.minus(a, b), one - other),
        (vectors.times(a, factor), one * factor),
        (vectors.plus_times(a, b, factor), one + other * factor),
        (vectors.dot(a, b), one @ other),
        (vectors.cross(a, b), np.cross(one, other)),
        (vectors.norm(a), np.linalg.norm(one)),
    ):
        np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-9)


@given(triples, triples, st.floats(0.0, 50.0))
def test_towards_a_goal_goes_straight_as_far_as_it_may_and_never_beyond(
    a: Floats3, goal: Floats3, most: float
) -> None:
    reached, way = vectors.towards(a, goal, most), np.subtract(goal, a)
    size = float(np.linalg.norm(way))
    if size <= most:
        assert reached == goal
    else:
        np.testing.assert_allclose(reached, a + way * (most / size), atol=1e-9)


@given(triples, st.floats(0.0, 50.0))
def test_a_shortened_vector_keeps_its_direction_and_its_bound(a: Floats3, bound: float) -> None:
    short, size = vectors.shortened(a, bound), vectors.norm(a)
    if size <= bound:
        assert short == a
    else:
        np.testing.assert_allclose(short, np.array(a) * (bound / size), atol=1e-9)
        assert vectors.norm(short) <= bound * (1 + 1e-12)
