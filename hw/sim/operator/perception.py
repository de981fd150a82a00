"""Interface between the operator's eyes and mind: what they believe of the scene.

The mind (`hw.sim.operator.operator`) gets `Percept`s and nothing else. They come from the received
images (`hw.sim.operator.seeing`) or, in the demo, from the true scene (`hw.sim.operator.demo`).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

from tams_app.records import Pose


@dataclass(frozen=True, slots=True)
class PoseEstimate:
    """A pose in the arm's base frame and its standard deviations; infinite when out of sight."""

    pose: Pose
    position_sigma: float = 0.0  # [m]
    rotation_sigma: float = 0.0  # [rad], about the vertical


@dataclass(frozen=True, slots=True)
class GapSigmas:
    """Standard deviations of the tool as seen against block and container.

    Better known than either place where one image shows both.
    """

    block: float  # [m]
    container: float  # [m]
    heading: float  # [rad], of the block against the tool


@dataclass(frozen=True, slots=True)
class Percept:
    """The scene as it looked at `t_ns`: when the view was captured, as far as the operator knows.

    Block and tool are their centres; of the container only x and y are used.
    `fingers_opening` [m] is None when the fingers cannot be made out.
    """

    t_ns: int
    tcp: PoseEstimate
    block: PoseEstimate
    container: PoseEstimate
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
