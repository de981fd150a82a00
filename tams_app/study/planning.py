"""The plan of a within-subjects study: a balanced Latin square, and seeds paired over strategies.

Williams, E. J. (1949), "Experimental designs balanced for the estimation of residual effects of
treatments", Australian Journal of Scientific Research A 2, 149–168.
"""

from __future__ import annotations

import hashlib
from collections.abc import Iterator, Sequence
from itertools import product
from typing import TypeAlias

from tams_app.config import Config
from tams_app.errors import ConfigError, not_one_of
from tams_app.policy.allocation import STRATEGIES
from tams_app.policy.budget import BUDGETS
from tams_app.policy.inference import INFERENCES
from tams_app.study.plan import Participant, ParticipantState, Plan, PlannedTrial

Condition: TypeAlias = tuple[str, str]  # strategy and network, a cell of the design

MAX_PARTICIPANTS = 9999
_SEED_BITS = 31


def make_plan(config: Config, participants: int) -> Plan:
    """The plan that `config.study` and `config.seed` ask for; ConfigError on unknown names."""
    study = config.study
    if not 1 <= participants <= MAX_PARTICIPANTS:
        raise ConfigError(f"participants: must be 1 to {MAX_PARTICIPANTS}, not {participants}")
    for strategy in study.strategies:
        STRATEGIES[strategy](config.policy)
    if study.budget not in BUDGETS:
        raise ConfigError(f"study.budget: {not_one_of(study.budget, BUDGETS)}")
    _ = INFERENCES[config.policy.phases.inference]
    for network in study.networks:
        if network not in config.networks:
            raise ConfigError(f"study.networks: {not_one_of(network, config.networks)}")
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
    """A sentence on the balance of conditions over the participants whose data are here."""
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
        (*condition, repetition)
        for condition, repetition in schedule(cells, number, study.repetitions)
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


def conditions(strategies: Sequence[str], networks: Sequence[str]) -> tuple[Condition, ...]:
    """Every strategy on every network."""
    return tuple((strategy, network) for network, strategy in product(networks, strategies))


def williams_square(size: int) -> tuple[tuple[int, ...], ...]:
    """Sequences of 0 … size−1: `size` of them where it is even, else twice as many.

    In the full set each treatment is in each position equally often, and directly precedes each
    other treatment equally often (once for even sizes, twice for odd ones above 1).
    """
    if size < 1:
        raise ValueError("a design needs at least one condition")
    first = [(place + 1) // 2 if place % 2 else (size - place // 2) % size for place in range(size)]
    rows = [tuple((treatment + row) % size for treatment in first) for row in range(size)]
    if size % 2 and size > 1:
        rows += [tuple(reversed(row)) for row in rows]
    return tuple(rows)


def sequences_needed(condition_count: int) -> int:
    """The number of participants in one whole square: 18 for nine conditions."""
    return len(williams_square(condition_count))


def is_counterbalanced(condition_count: int, participant_count: int) -> bool:
    """True if the participants fill whole squares."""
    needed = sequences_needed(condition_count)
    return participant_count >= needed and participant_count % needed == 0


def schedule(
    all_conditions: Sequence[Condition], participant: int, repetitions: int
) -> tuple[tuple[Condition, int], ...]:
    """The trials of participant number `participant` (from 0): (condition, repetition from 1).

    Each repetition is one whole sequence of its own, so that over whole squares of participants
    every repetition is balanced by itself.
    """
    square = williams_square(len(all_conditions))
    shift = max(1, len(square) // repetitions)
    return tuple(
        (all_conditions[place], repetition + 1)
        for repetition in range(repetitions)
        for place in square[(participant + repetition * shift) % len(square)]
    )


def derive_seed(study_seed: int, *parts: str | int) -> int:
    """A seed of 31 bits from the study's and what it is for; the same on every machine.

    Scene, noise and losses of a trial hang on participant, network and repetition, not on the
    strategy: what differs within such a set of trials is the strategy alone.
    """
    text = "/".join(str(part) for part in (study_seed, *parts))
    digest = hashlib.sha256(text.encode()).digest()
    return int.from_bytes(digest[:8]) >> (64 - _SEED_BITS)
