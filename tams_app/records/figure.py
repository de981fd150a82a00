"""What a viewer needs to draw an arm and the things around it: solids, and where they are."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

from tams_app.records.geometry import Pose, Vector
from tams_app.vectors import Floats3


class SolidKind(Enum):
    """The forms there are."""

    BOX = "box"
    CYLINDER = "cylinder"  # along z


@dataclass(frozen=True, slots=True)
class Solid:
    """A form in some frame: its middle, its whole extent x, y, z [m], its colour (0 to 1)."""

    kind: SolidKind
    pose: Pose
    extent: Floats3
    colour: Floats3


class ArmFigure(Protocol):
    """How an arm looks."""

    @property
    def flange(self) -> str:
        """The frame that the tool is mounted on."""

    @property
    def solids(self) -> Mapping[str, tuple[Solid, ...]]:
        """Those of each link, by the name of its frame; `base` does not move."""

    def place(self, joints: Vector) -> Mapping[str, Pose]:
        """Where the links' frames are in the base frame, for `joints` [rad], shape (6,)."""
