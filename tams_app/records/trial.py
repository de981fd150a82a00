"""The trial: where things are, the verdict, what the simulated operator sees."""

from __future__ import annotations

from dataclasses import dataclass

from tams_app.records.geometry import Pose


@dataclass(frozen=True, slots=True)
class SceneTruth:
    """Where things really are (simulated rig only), in the arm's base frame."""

    t_ns: int
    block: Pose
    container: Pose
    tcp: Pose
    block_speed: float  # [m/s]
    fingers_opening: float  # [m], 0 closed


@dataclass(frozen=True, slots=True)
class Outcome:
    """The verdict on a trial (docs/GLOSSARY.md, Trial); None where it was not judged."""

    completed: bool | None
    success: bool | None
    completion_time_s: float | None
    drops: int | None
    reason: str


@dataclass(frozen=True, slots=True)
class OperatorGlance:
    """Which view told the simulated operator how much in one glance at the screen.

    Shares of what the glance added to knowing the vector from tool to block and from tool to
    container: by view, summing to 1; empty when the glance told nothing.
    """

    t_ns: int
    stage: str  # of the task, as the operator believes
    to_block: dict[str, float]
    to_container: dict[str, float]
    about_block: bool  # what the stage is about: the block, else the container
    block_sigma: float  # [m], after the glance
    container_sigma: float  # [m]
    lag_ns: int  # hand to eye, as the operator judges it
    hanging: tuple[str, ...]  # views in which nothing moves although the hand does

    @property
    def relied_on(self) -> dict[str, float]:
        """The shares that counted for what the stage is about."""
        return self.to_block if self.about_block else self.to_container

    @property
    def sigma(self) -> float:
        """How surely the vector to what the stage is about was known [m]."""
        return self.block_sigma if self.about_block else self.container_sigma
