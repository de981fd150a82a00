"""Phases of the task, and what the policy asks of the encoders."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from tams_app.records.record import Record, TimeNs


class Phase(StrEnum):
    """The six phases of the pick-and-place task (paper, section II)."""

    REACH = "REACH"
    ALIGN = "ALIGN"
    GRASP = "GRASP"
    TRANSPORT = "TRANSPORT"
    PRE_RELEASE = "PRE_RELEASE"
    RELEASE = "RELEASE"

    @property
    def word(self) -> str:
        """As the paper writes it, such as Pre-release."""
        return self.value.replace("_", "-").capitalize()


@dataclass(frozen=True, slots=True)
class PhaseChange(Record):
    """A phase began."""

    t_ns: TimeNs
    phase: Annotated[Phase, "phase of the task"]
    reason: Annotated[str, "the line of Algorithm 1 that decided"]


@dataclass(frozen=True, slots=True)
class PinnedView(Record):
    """The operator pinned a view: it is the primary one from now on, whatever the phase."""

    t_ns: TimeNs
    view: Annotated[str, 'the view; "": none is pinned any more']


@dataclass(frozen=True, slots=True)
class Allocation(Record):
    """What the policy asked of the encoders at one instant."""

    t_ns: TimeNs
    phase: Annotated[
        Phase,
        "phase whose row of W applied: the task's, or while a view is pinned one in which that is "
        "primary",
    ]
    capacity_kbps: Annotated[float, "what the uplink is believed to carry [kbit/s of IP datagrams]"]
    budget_kbps: Annotated[
        float, "B: the capacity after the safety factor [kbit/s of IP datagrams]"
    ]
    target_kbps: Annotated[
        dict[str, int],
        "target of each view [kbit/s of IP datagrams]; the sum never exceeds B",
    ]
