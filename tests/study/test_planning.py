"""From configuration to plan: who does what in which order, with which seeds."""

from __future__ import annotations

import csv
from collections import Counter, defaultdict
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.config import load_config
from tams_app.errors import ConfigError
from tams_app.runtime.process import PROJECT_DIRECTORY
from tams_app.study.plan import Attempt, AttemptState, ParticipantState, void
from tams_app.study.planning import (
    balance_sentence,
    conditions,
    derive_seed,
    is_counterbalanced,
    make_plan,
    schedule,
    sequences_needed,
    williams_square,
)
from tests.study.synthetic_study import small_config

pytestmark = pytest.mark.untimed


def test_seeds_are_the_same_on_every_machine() -> None:
    assert derive_seed(0, "P01", "s2", 1) == 581446635


def test_the_published_study_is_planned_as_it_was_run() -> None:
    """Who does what in which order, with which seeds, must never change for a study's seed."""
    plan = make_plan(load_config(None, {"study.repetitions": 1}), 18)
    names = ("participant", "strategy", "network", "order", "seed", "participant_seed")
    planned = {(one.id, *(str(getattr(one, name)) for name in names)) for one in plan.trials}
    with (PROJECT_DIRECTORY / "docs/study/trials.csv").open(encoding="utf-8") as file:
        run = {(row["trial"], *(row[name] for name in names)) for row in csv.DictReader(file)}
    assert planned == run
    assert balance_sentence(plan).startswith("Counterbalanced: 18 participants")
    assert [one.id for one in plan.trials[:9]] == [f"P01-{number:02}" for number in range(1, 10)]


def test_a_forgotten_participant_breaks_the_balance() -> None:
    plan = make_plan(small_config(), 18)
    gone = plan.participants[3].model_copy(update={"state": ParticipantState.FORGOTTEN})
    assert balance_sentence(plan.with_participant(gone)).startswith("Not counterbalanced")


def test_strategies_share_their_seed_and_nothing_else_does() -> None:
    plan = make_plan(small_config(study__repetitions=2), 3)
    seeds = defaultdict(set)
    strategies = defaultdict(list)
    for trial in plan.trials:
        key = (trial.participant, trial.network, trial.repetition)
        seeds[key].add(trial.seed)
        strategies[key].append(trial.strategy)
    assert all(len(found) == 1 for found in seeds.values())
    assert all(sorted(found) == ["equal", "static", "tams"] for found in strategies.values())
    assert len({seed for found in seeds.values() for seed in found}) == len(seeds) == 18
    people = {(trial.participant, trial.participant_seed) for trial in plan.trials}
    assert len(people) == 3


def test_practice_comes_first_and_is_apart() -> None:
    plan = make_plan(small_config(study__practice_trials=2), 1)
    assert [trial.practice for trial in plan.trials] == [True, True] + [False] * 9
    assert {trial.network for trial in plan.trials[:2]} == {"s1"}
    counted = {trial.seed for trial in plan.trials[2:]}
    assert not counted & {trial.seed for trial in plan.trials[:2]}


@pytest.mark.parametrize(
    ("overrides", "sentence"),
    [
        ({"study__networks": ["s9"]}, "study.networks: 's9' is not one of s1, s2, s3, none"),
        ({"study__strategies": ["equal", "tams", "best"]}, "'best' is not one of"),
        (
            {"study__budget": "guess"},
            "study.budget: 'guess' is not one of oracle, sender, feedback",
        ),
        ({"policy__phases__inference": "guess"}, "policy.phases.inference: 'guess' is not one of"),
        ({"study__reference": "best"}, "reference must be one of"),
        ({"study__networks": ["s1", "s1"]}, "named once only"),
    ],
)
def test_a_study_that_cannot_be_is_refused_and_unknown_names_with_the_valid_ones(
    overrides: dict[str, object], sentence: str
) -> None:
    with pytest.raises(ConfigError, match=sentence):
        make_plan(small_config(**overrides), 1)


def test_a_void_trial_is_left_until_it_is_taken_again() -> None:
    plan = make_plan(small_config(), 1)
    trial_id = plan.trials[0].id
    with pytest.raises(ConfigError, match="no finished attempt"):
        void(plan, trial_id, "why")
    plan = plan.with_attempt(trial_id, Attempt(folder="a1", state=AttemptState.DONE))
    assert plan.trial(trial_id).is_done
    with pytest.raises(ConfigError, match="say why"):
        void(plan, trial_id, "  ")
    plan = void(plan, trial_id, "the phone rang")
    assert plan.left[0].id == trial_id
    plan = plan.with_attempt(trial_id, Attempt(folder="a2", state=AttemptState.DONE))
    assert plan.trial(trial_id).is_done
    assert plan.trial(trial_id).attempts[0].reason == "the phone rang"
    with pytest.raises(ConfigError, match="no such trial"):
        plan.trial("P99-01")


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
