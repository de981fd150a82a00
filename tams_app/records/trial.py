"""Trial and episodes: where things are, the verdicts, what the simulated operator sees."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from tams_app.records.geometry import Pose
from tams_app.records.record import Record, TimeNs


@dataclass(frozen=True, slots=True)
class SceneTruth(Record):
    """Where things really are (simulated rig only)."""

    t_ns: TimeNs
    block: Annotated[Pose, "where the block is, base frame"]
    container: Annotated[Pose, "where the container is, base frame"]
    tcp: Annotated[Pose, "the tool centre point, base frame"]
    block_speed: Annotated[float, "of the block [m/s]"]
    fingers_opening: Annotated[float, "between the fingers [m]; 0: closed"]


@dataclass(frozen=True, slots=True)
class Placed(Record):
    """The judge of the simulated rig has seen the block placed, or it was put back for another."""

    t_ns: TimeNs
    placed: Annotated[bool, "whether it is placed; false: it was put back"]


@dataclass(frozen=True, slots=True)
class Outcome(Record):
    """The verdict on a trial (docs/GLOSSARY.md, Trial)."""

    completed: Annotated[bool | None, "whether the block was placed in time; null: not judged"]
    success: Annotated[
        bool | None, "whether it was placed well in time with few drops; null: not judged"
    ]
    completion_time_s: Annotated[
        float | None, "from the first engagement to the placing [s]; null: not judged"
    ]
    drops: Annotated[int | None, "of the block; null: not judged"]
    reason: Annotated[str, "why the session ended"]


@dataclass(frozen=True, slots=True)
class OperatorGlance(Record):
    """Which view gave the simulated operator how much in one glance at the screen."""

    t_ns: TimeNs
    stage: Annotated[str, "of the task, as the operator believes"]
    to_block: Annotated[
        dict[str, float],
        "share of each view in what the glance showed of tool to block, sum 1; empty: nothing",
    ]
    to_container: Annotated[
        dict[str, float],
        "share of each view in what the glance showed of tool to container, sum 1; empty: nothing",
    ]
    about_block: Annotated[bool, "whether the stage is about the block, else the container"]
    block_sigma: Annotated[
        float, "how surely tool to block is known after the glance, standard deviation [m]"
    ]
    container_sigma: Annotated[
        float, "how surely tool to container is known after the glance, standard deviation [m]"
    ]
    lag_ns: Annotated[int, "hand to eye, as the operator judges it [ns]"]
    hanging: Annotated[tuple[str, ...], "views in which nothing moves although the hand does"]

    @property
    def relied_on(self) -> dict[str, float]:
        """The shares that counted for what the stage is about."""
        return self.to_block if self.about_block else self.to_container

    @property
    def sigma(self) -> float:
        """How surely the vector to what the stage is about was known [m]."""
        return self.block_sigma if self.about_block else self.container_sigma


class EpisodeRequest(StrEnum):
    """A person's request about episodes; the order is that of the counts in a link's message."""

    NEXT = "next"  # begin one; end the one that is recorded, and keep it
    DISCARD = "discard"
    REDO = "redo"  # discard, and begin the next
    SUCCESS = "success"
    FAILURE = "failure"


@dataclass(frozen=True, slots=True)
class Episode(Record):
    """An episode that has ended, written then and at each later verdict: the newest counts."""

    t_ns: TimeNs
    number: Annotated[int, "of the episode, from 1 in each session"]
    start_ns: Annotated[int, "when it began [ns]"]
    end_ns: Annotated[int, "when it ended, an instant that is not part of it [ns]"]
    kept: Annotated[bool, "whether it is kept, and not discarded"] = True
    success: Annotated[bool | None, "whether a person called it a success; null: nobody said"] = (
        None
    )
