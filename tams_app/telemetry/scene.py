"""What every viewer is shown in space: frames and their poses, and at which pace."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from tams_app.records import ArmFigure, ArmState, Lens, Pose, SceneTruth, Solid
from tams_app.units import NS_PER_S
from tams_app.vectors import Floats3

BASE = "base"
TRACKING = "tracking"
MOTION_HZ = 30.0

PlacedFrame: TypeAlias = tuple[str, str, Pose]
"""A frame's parent, its name, and its pose in the parent."""


class Pace:
    """Of what comes, lets pass the first and then `rate_hz` a second."""

    def __init__(self, rate_hz: float) -> None:
        self._period_ns = round(NS_PER_S / rate_hz)
        self._due_ns: int | None = None

    def is_due(self, t_ns: int) -> bool:
        """True if it is time, at `t_ns`; each True counts as sent."""
        due_ns = t_ns if self._due_ns is None else self._due_ns
        if t_ns < due_ns:
            return False
        self._due_ns = max(due_ns + self._period_ns, t_ns)  # what was missed is not made up for
        return True


@dataclass(frozen=True, slots=True)
class Scene:
    """The surroundings as they are known when a session starts."""

    figure: ArmFigure | None  # None: not known
    workspace: tuple[Floats3, Floats3]  # lower and upper corner for the TCP, base frame [m]
    tracking: Pose  # of the controller's tracking frame in the base frame
    twist_lasts_s: float  # a velocity command without another moves the arm so long
    things: Mapping[str, tuple[Solid, ...]]  # by frame; none where only a camera sees them
    lenses: Mapping[str, Lens]  # by view; none where they were not measured

    def arm_frames(self, arm: ArmState) -> Iterator[PlacedFrame]:
        """The TCP as reported, and the links as the reported joints put them."""
        yield tcp_frame(arm)
        if self.figure is not None:
            for link, pose in self.figure.place(arm.joints).items():
                yield BASE, link, pose

    def still_frames(self) -> Iterator[PlacedFrame]:
        """What does not move in its parent: tracking, and the views."""
        yield BASE, TRACKING, self.tracking
        for view, lens in self.lenses.items():
            yield lens.parent, view, lens.pose


def tcp_frame(arm: ArmState) -> PlacedFrame:
    """The TCP as reported, which needs no scene."""
    return BASE, "tcp", arm.tcp


def thing_frames(truth: SceneTruth) -> Iterator[PlacedFrame]:
    """The rig's things."""
    yield BASE, "block", truth.block
    yield BASE, "container", truth.container


def joint_angles(arm: ArmState) -> dict[str, float]:
    """The reported angles [rad] by the joints' names, from the base on."""
    angles = arm.joints.tolist()
    return {f"joint{number}": angle for number, angle in enumerate(angles, start=1)}
