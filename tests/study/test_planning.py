"""From configuration to plan."""

from __future__ import annotations

import csv
from collections import defaultdict

import pytest

from tams_app.config import load_config
from tams_app.errors import ConfigError
from tams_app.runtime.process import PROJECT_DIRECTORY
from tams_app.study.plan import Attempt, AttemptState, ParticipantState, void
from tams_app.study.planning import balance_sentence, make_plan
from tests.study.synthetic_study import small_config

pytestmark = pytest.mark.untimed


def test_the_published_study_is_planned_as_it_was_run() -> None:
    """Who does what in which order, with which seeds, must never change for a study's seed."""
    plan = make_plan(load_config(None, {"study.repetitions": 1}), 18)
    planned = {
        (
            one.id,
            one.participant,
            one.strategy,
            one.network,
            one.order,
            one.seed,
            one.participant_seed,
        )
        for one in plan.trials
    }
    with (PROJECT_DIRECTORY / "docs/study/trials.csv").open(encoding="utf-8") as file:
        run = {
            (
                row["trial"],
                row["participant"],
                row["strategy"],
                row["network"],
                int(row["order"]),
                int(row["seed"]),
                int(row["participant_seed"]),
            )
            for row in csv.DictReader(file)
        }
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
        ({"study__repetitions": 0}, "study.repetitions"),
    ],
)
def test_a_study_that_cannot_be_is_refused_and_unknown_names_with_the_valid_ones(
    overrides: dict[str, object], sentence: str
) -> None:
    with pytest.raises(ConfigError, match=sentence):
        make_plan(small_config(**overrides), 1)


@pytest.mark.parametrize("participants", [0, -1, 10_000])
def test_a_wrong_number_of_participants_is_refused(participants: int) -> None:
    with pytest.raises(ConfigError, match="participants"):
        make_plan(small_config(), participants)


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
