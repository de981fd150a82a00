"""Differences between two strategies over trials that share scene, noise and losses."""

from __future__ import annotations

from collections.abc import Hashable, Mapping
from dataclasses import dataclass

from tams_app.study.statistics.intervals import Estimate, bootstrap_mean, means_by_unit

Key = tuple[str, Hashable]  # participant, and what else the pair shares


@dataclass(frozen=True, slots=True)
class PairedDifference:
    """First minus second: the mean over participants of each one's mean difference.

    The interval is bootstrapped over participants; `unpaired`: trials without their counterpart.
    """

    estimate: Estimate | None
    pairs: int
    unpaired: int


def paired_difference(first: Mapping[Key, float], second: Mapping[Key, float]) -> PairedDifference:
    """Values by what the pair shares; the key begins with the participant."""
    shared = sorted(first.keys() & second.keys(), key=repr)
    by_participant: dict[str, list[float]] = {}
    for key in shared:
        by_participant.setdefault(key[0], []).append(first[key] - second[key])
    return PairedDifference(
        bootstrap_mean(means_by_unit(by_participant)),
        len(shared),
        len(first) + len(second) - 2 * len(shared),
    )
