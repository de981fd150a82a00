"""The order of conditions, and seeds."""

from __future__ import annotations

from collections import Counter
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.study.planning import (
    conditions,
    derive_seed,
    is_counterbalanced,
    schedule,
    sequences_needed,
    williams_square,
)

pytestmark = pytest.mark.untimed


@given(st.integers(2, 15))
def test_conditions_are_in_each_position_and_directly_after_each_other_equally_often(
    size: int,
) -> None:
    square = williams_square(size)
    assert all(sorted(sequence) == list(range(size)) for sequence in square)
    times = len(square) // size
    for at_place in zip(*square, strict=True):
        assert Counter(at_place) == dict.fromkeys(range(size), times)
    pairs = Counter(pair for sequence in square for pair in pairwise(sequence))
    assert len(pairs) == size * (size - 1)
    assert set(pairs.values()) == {times}


def test_nine_conditions_need_eighteen_sequences_and_four_need_four() -> None:
    assert (sequences_needed(9), sequences_needed(4), sequences_needed(1)) == (18, 4, 1)
    # Williams' square of four, as textbooks print it
    assert williams_square(4) == ((0, 1, 3, 2), (1, 2, 0, 3), (2, 3, 1, 0), (3, 0, 2, 1))


def test_only_whole_squares_are_counterbalanced() -> None:
    counted = [number for number in range(1, 60) if is_counterbalanced(9, number)]
    assert counted == [18, 36, 54]


def test_a_design_without_conditions_is_refused() -> None:
    with pytest.raises(ValueError, match="at least one"):
        williams_square(0)


@given(st.integers(1, 4), st.integers(1, 4), st.integers(1, 5), st.integers(0, 40))
def test_each_participant_meets_each_condition_once_per_repetition(
    strategies: int, networks: int, repetitions: int, participant: int
) -> None:
    cells = conditions([f"a{n}" for n in range(strategies)], [f"n{n}" for n in range(networks)])
    slots = schedule(cells, participant, repetitions)
    assert Counter(slots) == {
        (cell, repetition): 1 for cell in cells for repetition in range(1, repetitions + 1)
    }
    assert [repetition for _, repetition in slots] == sorted(repetition for _, repetition in slots)


@given(st.integers(1, 4))
def test_over_a_whole_square_of_participants_each_repetition_is_balanced(repetitions: int) -> None:
    cells = conditions(("equal", "static", "tams"), ("s1", "s2", "s3"))
    everyone = [schedule(cells, number, repetitions) for number in range(18)]
    for repetition in range(1, repetitions + 1):
        rows = [[cell for cell, number in one if number == repetition] for one in everyone]
        neighbours = Counter(pair for row in rows for pair in pairwise(row))
        assert set(neighbours.values()) == {2}
        assert set(Counter(row[0] for row in rows).values()) == {2}


def test_a_participant_meets_another_order_in_each_repetition() -> None:
    cells = conditions(("equal", "static", "tams"), ("s1", "s2", "s3"))
    for participant in range(18):
        slots = schedule(cells, participant, 3)
        orders = {tuple(cell for cell, number in slots if number == one) for one in (1, 2, 3)}
        assert len(orders) == 3


@given(st.integers(0, 2**31), st.text(max_size=5), st.integers(0, 99))
def test_seeds_fit_the_configuration_and_depend_on_every_part(
    seed: int, text: str, number: int
) -> None:
    derived = derive_seed(seed, text, number)
    assert 0 <= derived < 2**31
    assert derived == derive_seed(seed, text, number)
    assert derived != derive_seed(seed + 1, text, number)
    assert derived != derive_seed(seed, text, number + 1)


def test_seeds_are_the_same_on_every_machine() -> None:
    assert derive_seed(0, "P01", "s2", 1) == 581446635
