"""From a configuration to a plan."""

from __future__ import annotations

from collections.abc import Iterator

from tams_app.config import Config
from tams_app.errors import ConfigError
from tams_app.policy.allocation import make_strategy
from tams_app.study.design import (
    Condition,
    conditions,
    derive_seed,
    is_counterbalanced,
    schedule,
    sequences_needed,
)
from tams_app.study.plan import Participant, ParticipantState, Plan, PlannedTrial

MAX_PARTICIPANTS = 9999


def make_plan(config: Config, participants: int) -> Plan:
    """The plan that `config.study` and `config.seed` ask for; ConfigError on unknown names."""
    study = config.study
    if not 1 <= participants <= MAX_PARTICIPANTS:
        raise ConfigError(f"participants: must be 1 to {MAX_PARTICIPANTS}, not {participants}")
    for strategy in study.strategies:
        make_strategy(strategy, config.policy)
    for network in study.networks:
        if network not in config.networks:
            names = ", ".join(config.networks)
            raise ConfigError(f"study.networks: {network!r} is none of {names}")
    cells = conditions(study.strategies, study.networks)
    rows = sequences_needed(len(cells))
    people = tuple(
        Participant(id=f"P{number + 1:02}", sequence=number % rows)
        for number in range(participants)
    )
    trials = tuple(
        trial
        for number, person in enumerate(people)
        for trial in _trials_of(config, cells, number, person.id)
    )
    return Plan(
        name=study.title,
        seed=config.seed,
        simulated=config.rig.enabled,
        strategies=study.strategies,
        networks=study.networks,
        reference=study.reference,
        proposed=study.proposed,
        repetitions=study.repetitions,
        participants=people,
        trials=trials,
    )


def balance_sentence(plan: Plan) -> str:
    """Whether the order of conditions is balanced over the participants whose data are here."""
    count = len(plan.strategies) * len(plan.networks)
    here = [one for one in plan.participants if one.state is ParticipantState.TAKES_PART]
    needed = sequences_needed(count)
    if len(here) < len(plan.participants) or not is_counterbalanced(count, len(here)):
        return (
            f"Not counterbalanced: the balanced Latin square of {count} conditions has {needed} "
            f"sequences and needs as many participants or a multiple; this study has {len(here)}."
        )
    return (
        f"Counterbalanced: {len(here)} participants fill the balanced Latin square of {count} "
        f"conditions ({needed} sequences)."
    )


def _trials_of(
    config: Config, cells: tuple[Condition, ...], number: int, pseudonym: str
) -> Iterator[PlannedTrial]:
    study, seed = config.study, config.seed
    person_seed = derive_seed(seed, pseudonym)
    practice = [(study.reference, study.networks[0], 0)] * study.practice_trials
    counted = [
        (slot.condition.strategy, slot.condition.network, slot.repetition)
        for slot in schedule(cells, number, study.repetitions)
    ]
    for order, (strategy, network, repetition) in enumerate([*practice, *counted], start=1):
        paired = (network, repetition) if repetition else ("practice", order)
        yield PlannedTrial(
            id=f"{pseudonym}-{order:02}",
            participant=pseudonym,
            order=order,
            strategy=strategy,
            network=network,
            repetition=repetition,
            seed=derive_seed(seed, pseudonym, *paired),
            participant_seed=person_seed,
        )
