"""What the operator believes of the scene: the seam between his eyes and his hand.

The operator lives on `Percept`s alone. Where they come from is another matter: from the true
scene here, from received images for an operator who really looks.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Protocol

from tams_app.records import Pose, SceneTruth


@dataclass(frozen=True, slots=True)
class Estimate:
    """A pose in the arm's base frame and its standard deviations; infinite when out of sight."""

    pose: Pose
    position_sigma: float = 0.0  # [m]
    rotation_sigma: float = 0.0  # [rad], about the vertical


@dataclass(frozen=True, slots=True)
class GapSigmas:
    """How surely the tool is seen against block and container: standard deviations.

    Better known than either place where one image shows both.
    """

    block: float  # [m]
    container: float  # [m]
    heading: float  # [rad], of the block against the tool


@dataclass(frozen=True, slots=True)
class Percept:
    """The scene as it looked at `t_ns`: when the view was captured, as far as he who looks knows.

    Block and tool are their centres; of the container only x and y are used.
    `fingers_opening` [m] is None when the fingers cannot be made out.
    """

    t_ns: int
    tcp: Estimate
    block: Estimate
    container: Estimate
    fingers_opening: float | None
    seen_gaps: GapSigmas | None = None

    @property
    def gaps(self) -> GapSigmas:
        """As seen, else from the places' own uncertainties."""
        if self.seen_gaps is not None:
            return self.seen_gaps
        tool, block, container = self.tcp, self.block, self.container
        return GapSigmas(
            math.hypot(block.position_sigma, tool.position_sigma),
            math.hypot(container.position_sigma, tool.position_sigma),
            block.rotation_sigma + tool.rotation_sigma,
        )


class Perception(Protocol):
    """The operator's eyes."""

    def look(self, now_ns: int) -> Percept | None:
        """The newest view at `now_ns`, None while there is nothing to see; does not block."""


class TruePerception:
    """Perfect eyes: every view is the true scene, without delay beyond that of its source."""

    def __init__(self, read: Callable[[], SceneTruth | None]) -> None:
        self._read = read

    def look(self, now_ns: int) -> Percept | None:
        truth = self._read()
        if truth is None:
            return None
        return Percept(
            truth.t_ns,
            Estimate(truth.tcp),
            Estimate(truth.block),
            Estimate(truth.container),
            truth.fingers_opening,
        )
