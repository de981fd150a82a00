"""What Foxglove and ROS 2 are shown alike: frames and their poses, at which pace, and sentences."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import TypeAlias

from tams_app.recording.topics import OutcomeGiven
from tams_app.records import (
    ArmFigure,
    ArmState,
    Lens,
    Note,
    Outcome,
    Pose,
    SceneTruth,
    Solid,
    StopRecord,
)
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


Spoken: TypeAlias = Note | StopRecord | OutcomeGiven


@dataclass(frozen=True, slots=True)
class Line:
    """A sentence with its time, level (info, warning, error) and kind (note, stop, outcome)."""

    t_ns: int
    level: str
    kind: str
    text: str


def line_of(record: Spoken) -> Line:
    """The sentence that a record amounts to; a stop that was not the operator's is an error."""
    if isinstance(record, Note):
        return Line(record.t_ns, record.level, "note", record.text)
    if isinstance(record, OutcomeGiven):
        return Line(record.t_ns, "info", "outcome", _sentence(record.outcome))
    if record.rest_ms is None:
        how = "the session ended before the arm was seen at rest"
    else:
        how = f"at rest after {record.rest_ms:.0f} ms"
    return Line(record.visible_ns, "error", "stop", f"stop, {record.reason}: {how}")


def _sentence(outcome: Outcome) -> str:
    if outcome.completed is None:
        return f"not judged: {outcome.reason}"
    if outcome.success is None:  # as the operator's side alone knows it
        return f"{'placed' if outcome.completed else 'not placed'}: {outcome.reason}"
    if not outcome.completed:
        return f"not completed, {outcome.drops} drops: {outcome.reason}"
    verdict = "a success" if outcome.success else "no success"
    return (
        f"completed in {outcome.completion_time_s:.1f} s, {outcome.drops} drops, "
        f"{verdict}: {outcome.reason}"
    )
