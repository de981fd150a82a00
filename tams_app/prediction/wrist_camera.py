"""A camera on the arm, described so that another process can correct its frames."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec
import numpy as np

from tams_app.prediction.plane_warp import WristWarp
from tams_app.prediction.present import MountTrail, WristView
from tams_app.records import Lens, Pose, Solid, SolidKind
from tams_app.rotation import Rotation
from tams_app.vectors import ZERO, Floats3

Numbers7 = tuple[float, float, float, float, float, float, float]


class ToolPart(msgspec.Struct, frozen=True):
    """A part of the tool in the mount's frame: form, pose (position, quaternion), extent [m]."""

    form: str
    pose: Numbers7
    extent: Floats3

    @staticmethod
    def all_of(solids: Iterable[Solid]) -> tuple[ToolPart, ...]:
        """The descriptions of `solids`."""
        return tuple(ToolPart(one.kind.value, numbers7(one.pose), one.extent) for one in solids)

    @property
    def solid(self) -> Solid:
        """What is described, without its colour."""
        return Solid(SolidKind(self.form), pose7(self.pose), self.extent, ZERO)


class WristCamera(msgspec.Struct, frozen=True):
    """Its pose on the mount (position [m], quaternion), its picture, and the tool before it.

    grip: what closed fingers cover besides.
    """

    pose: Numbers7
    fovy_deg: float
    width: int
    height: int
    tool: tuple[ToolPart, ...] = ()
    grip: tuple[ToolPart, ...] = ()

    @staticmethod
    def of(lens: Lens, tool: Iterable[Solid], grip: Iterable[Solid] = ()) -> WristCamera:
        """`tool`, `grip`: in the frame that the lens is mounted on."""
        size = lens.width, lens.height
        return WristCamera(
            numbers7(lens.pose), lens.fovy_deg, *size, ToolPart.all_of(tool), ToolPart.all_of(grip)
        )

    def view(self, trail: MountTrail) -> WristView:
        """What corrects its frames; `trail`: of its mount."""
        lens = Lens("mount", pose7(self.pose), self.fovy_deg, self.width, self.height)
        tool, grip = ([part.solid for part in parts] for parts in (self.tool, self.grip))
        return WristView(WristWarp(lens, tool, grip), trail)


def numbers7(pose: Pose) -> Numbers7:
    """Position [m] and quaternion."""
    x, y, z = pose.position.tolist()
    return (x, y, z, *pose.rotation)


def pose7(numbers: Numbers7) -> Pose:
    """The pose of `numbers7`."""
    x, y, z, *quaternion = numbers
    return Pose(np.array((x, y, z)), Rotation(*quaternion))
