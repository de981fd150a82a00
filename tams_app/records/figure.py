"""What it takes to draw an arm and the things around it: solids, where they are, and cameras."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from enum import Enum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

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
        """Those of each link, by the name of its frame; `base` does not move. Fingers are open."""

    @property
    def grip(self) -> tuple[Solid, ...]:
        """What closed fingers cover besides, with what they may hold, in the flange's frame."""

    def place(self, joints: Vector) -> Mapping[str, Pose]:
        """Where the links' frames are in the base frame, for `joints` [rad], shape (6,)."""


def focal_length_px(fovy_deg: float, height_px: int) -> float:
    """The focal length of a lens with this vertical field of view."""
    return height_px / 2.0 / math.tan(math.radians(fovy_deg) / 2.0)


@dataclass(frozen=True, slots=True)
class Lens:
    """The pose of a view's camera in the frame `parent`, and its picture, without distortion.

    `pose`: x to the right, y down, z forwards in the picture.
    """

    parent: str
    pose: Pose
    fovy_deg: float  # vertical
    width: int
    height: int

    @property
    def focal_px(self) -> float:
        """The focal length in pixels, the same both ways."""
        return focal_length_px(self.fovy_deg, self.height)

    def matrix(self) -> NDArray[np.float64]:
        """Camera matrix, shape (3, 3), whose pixels have whole numbers in their middle."""
        focal = self.focal_px
        middle_x, middle_y = (self.width - 1) / 2.0, (self.height - 1) / 2.0
        return np.array([(focal, 0.0, middle_x), (0.0, focal, middle_y), (0.0, 0.0, 1.0)])
