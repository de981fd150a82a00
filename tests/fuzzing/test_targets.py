"""Every reader of foreign bytes, with its seeds, changed seeds, and all that fuzzing has found."""

from __future__ import annotations

import random

import pytest

from tests.fuzzing import CASES, TARGET_NAMES
from tests.fuzzing.seeds import seeds_of
from tests.fuzzing.targets import TARGETS

pytestmark = pytest.mark.untimed

_CHANGED_SEEDS = 40


def test_the_names_of_the_targets_are_those_of_the_targets() -> None:
    assert set(TARGET_NAMES) == TARGETS.keys()


@pytest.mark.parametrize("target", TARGETS)
def test_seeds_and_changed_seeds_raise_nothing_unexpected(target: str) -> None:
    draw = random.Random(7)
    seeds = seeds_of(target)
    for seed in seeds:
        TARGETS[target](seed)
    for _ in range(_CHANGED_SEEDS):
        changed = bytearray(draw.choice(seeds))
        for _ in range(draw.randint(1, 8)):
            changed[draw.randrange(len(changed))] = draw.randrange(256)
        TARGETS[target](bytes(changed[: draw.randint(1, len(changed))]))


@pytest.mark.parametrize("target", TARGETS)
def test_what_fuzzing_found_is_mended(target: str) -> None:
    for case in sorted((CASES / target).glob("*")):
        TARGETS[target](case.read_bytes())
