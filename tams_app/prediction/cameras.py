"""A camera, described so that another process can correct its frames."""

from __future__ import annotations

from typing import Any

import msgspec
import numpy as np

from tams_app.prediction.outline import ArmLink, ArmOutline
from tams_app.prediction.plane_warp import WristWarp
from tams_app.prediction.present import FixedView, MountTrail, WristView
from tams_app.records import Lens, Solid, Vector
from tams_app.vectors import ZERO, Floats3


class PredictedCamera(msgspec.Struct, frozen=True):
    """A camera, and the arm that it sees; msgspec needs the hooks `numbers_of` and `array_of`.

    lens: in the frame of the arm's mount if `on_arm`, with which it moves then; else of the base.
    tool, grip: in the frame of the mount; the latter is what closed fingers cover besides. tip: the
    TCP [m], in that frame. links: those before the mount, of a camera that stands still.
    """

    lens: Lens
    tool: tuple[Solid, ...]
    grip: tuple[Solid, ...] = ()
    on_arm: bool = True
    tip: Floats3 = ZERO
    links: tuple[ArmLink, ...] = ()

    def view(self, trail: MountTrail) -> WristView | FixedView:
        """What corrects its frames; `trail`: of the mount."""
        if self.on_arm:
            return WristView(WristWarp(self.lens, self.tool, self.grip), trail)
        return FixedView(ArmOutline(self.lens, self.tool, self.tip, self.links), trail)


def numbers_of(array: Vector) -> list[float]:
    """A pose's position as msgspec encodes it."""
    numbers: list[float] = array.tolist()
    return numbers


def array_of(_type: type, numbers: Any) -> Vector:
    """The position again."""
    position = np.array(numbers, float)
    if position.shape != (3,):
        raise ValueError(f"a position has three numbers, not {numbers}")
    return position
