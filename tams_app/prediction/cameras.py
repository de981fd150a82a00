"""A camera, described so that another process can correct its frames."""

from __future__ import annotations

from collections.abc import Iterable

import msgspec
import numpy as np

from tams_app.prediction.outline import ArmOutline, Link
from tams_app.prediction.plane_warp import WristWarp
from tams_app.prediction.present import FixedView, MountTrail, WristView
from tams_app.records import NO_DISTORTION, Lens, Pose, Solid, SolidKind
from tams_app.rotation import Rotation
from tams_app.vectors import ZERO, Floats3

Numbers4 = tuple[float, float, float, float]
Numbers5 = tuple[float, float, float, float, float]
Numbers7 = tuple[float, float, float, float, float, float, float]


class ArmPart(msgspec.Struct, frozen=True):
    """A part of the arm in its link's frame: form, pose (position, quaternion), extent [m]."""

    form: str
    pose: Numbers7
    extent: Floats3

    @staticmethod
    def all_of(solids: Iterable[Solid]) -> tuple[ArmPart, ...]:
        """The descriptions of `solids`."""
        return tuple(ArmPart(one.kind.value, numbers7(one.pose), one.extent) for one in solids)

    @property
    def solid(self) -> Solid:
        """What is described, without its colour."""
        return Solid(SolidKind(self.form), pose7(self.pose), self.extent, ZERO)


class ArmLink(msgspec.Struct, frozen=True):
    """A `Link` as it is sent to another process."""

    place: Numbers7
    parts: tuple[ArmPart, ...]

    @staticmethod
    def of(link: Link) -> ArmLink:
        """The description of `link`."""
        return ArmLink(numbers7(link.place), ArmPart.all_of(link.solids))

    @property
    def link(self) -> Link:
        """What is described."""
        return Link(pose7(self.place), tuple(part.solid for part in self.parts))


class PredictedCamera(msgspec.Struct, frozen=True):
    """Its pose (position [m], quaternion), its picture, and the arm that it sees.

    intrinsics: fx, fy, cx, cy [px]; distortion: as of a `Lens`.
    on_arm: it moves with the arm's mount, in whose frame its pose is then; else that of the base.
    grip: what closed fingers cover besides. tip: the TCP [m], in the frame of the mount.
    links: those before the mount, of a camera that stands still.
    """

    pose: Numbers7
    intrinsics: Numbers4
    width: int
    height: int
    distortion: Numbers5 = NO_DISTORTION
    tool: tuple[ArmPart, ...] = ()
    grip: tuple[ArmPart, ...] = ()
    on_arm: bool = True
    tip: Floats3 = ZERO
    links: tuple[ArmLink, ...] = ()

    @staticmethod
    def of(
        lens: Lens,
        tool: Iterable[Solid],
        grip: Iterable[Solid] = (),
        on_arm: bool = True,
        tip: Floats3 = ZERO,
        links: Iterable[Link] = (),
    ) -> PredictedCamera:
        """`tool`, `grip`, `tip`: in the frame of the mount."""
        return PredictedCamera(
            numbers7(lens.pose),
            (lens.fx, lens.fy, lens.cx, lens.cy),
            lens.width,
            lens.height,
            lens.distortion,
            ArmPart.all_of(tool),
            ArmPart.all_of(grip),
            on_arm,
            tip,
            tuple(ArmLink.of(link) for link in links),
        )

    @property
    def lens(self) -> Lens:
        """Of which it was made, with a parent `mount` or `base`."""
        parent = "mount" if self.on_arm else "base"
        size = self.width, self.height
        return Lens(parent, pose7(self.pose), *self.intrinsics, *size, self.distortion)

    def view(self, trail: MountTrail) -> WristView | FixedView:
        """What corrects its frames; `trail`: of the mount."""
        lens = self.lens
        tool, grip = ([part.solid for part in parts] for parts in (self.tool, self.grip))
        if self.on_arm:
            return WristView(WristWarp(lens, tool, grip), trail)
        links = (one.link for one in self.links)
        return FixedView(ArmOutline(lens, tool, self.tip, links), trail)


def numbers7(pose: Pose) -> Numbers7:
    """Position [m] and quaternion."""
    x, y, z = pose.position.tolist()
    return (x, y, z, *pose.rotation)


def pose7(numbers: Numbers7) -> Pose:
    """The pose of `numbers7`."""
    x, y, z, *quaternion = numbers
    return Pose(np.array((x, y, z)), Rotation(*quaternion))
