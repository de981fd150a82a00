"""Phases of the task, and what the policy asks of the encoders."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum


class Phase(StrEnum):
    """The six phases of the pick-and-place task (paper, section II)."""

    REACH = "REACH"
    ALIGN = "ALIGN"
    GRASP = "GRASP"
    TRANSPORT = "TRANSPORT"
    PRE_RELEASE = "PRE_RELEASE"
    RELEASE = "RELEASE"


@dataclass(frozen=True, slots=True)
class PhaseChange:
    """A phase began; `reason` says which line of Algorithm 1 decided."""

    t_ns: int
    phase: Phase
    reason: str


@dataclass(frozen=True, slots=True)
class Allocation:
    """What the policy asked of the encoders at one instant."""

    t_ns: int
    phase: Phase
    capacity_kbps: float  # what the budget source believes the uplink carries
    budget_kbps: float  # B: capacity after the safety factor
    target_kbps: dict[str, int]  # per view; the sum never exceeds B
