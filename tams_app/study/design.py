"""The order of a within-subjects study: a balanced Latin square, and seeds paired over strategies.

Pure. Williams, E. J. (1949), "Experimental designs balanced for the estimation of residual effects
of treatments", Australian Journal of Scientific Research A 2, 149–168.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

_SEED_BITS = 31


@dataclass(frozen=True, slots=True)
class Condition:
    """One cell of the design."""

    strategy: str
    network: str


@dataclass(frozen=True, slots=True)
class Slot:
    """One trial in the order in which its participant takes it; repetitions count from 1."""

    condition: Condition
    repetition: int


def conditions(strategies: Sequence[str], networks: Sequence[str]) -> tuple[Condition, ...]:
    """Every strategy on every network."""
    return tuple(
        Condition(strategy, network) for network, strategy in product(networks, strategies)
    )


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
    """How many participants make one whole square: 18 for nine conditions."""
    return len(williams_square(condition_count))


def is_counterbalanced(condition_count: int, participant_count: int) -> bool:
    """Whether the participants fill whole squares."""
    needed = sequences_needed(condition_count)
    return participant_count >= needed and participant_count % needed == 0


def schedule(
    all_conditions: Sequence[Condition], participant: int, repetitions: int
) -> tuple[Slot, ...]:
    """What participant number `participant` (from 0) does: each repetition is one whole sequence.

    A repetition takes a sequence of its own, so that over whole squares of participants every
    repetition is balanced by itself.
    """
    square = williams_square(len(all_conditions))
    shift = max(1, len(square) // repetitions)
    return tuple(
        Slot(all_conditions[place], repetition + 1)
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
