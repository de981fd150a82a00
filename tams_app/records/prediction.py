"""Where the arm was believed to be, at the operator's side."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from tams_app.records.geometry import Pose
from tams_app.records.record import Record


@dataclass(frozen=True, slots=True)
class MountPrediction(Record):
    """Where the arm's flange was, by its newest state, and is believed to be; base frame."""

    then_ns: Annotated[int, "when the newest state was, on the clock of the captures [ns]"]
    then: Annotated[Pose, "of the flange then"]
    now_ns: Annotated[int, "for when it is predicted, on the clock of the screen [ns]"]
    now: Annotated[Pose, "of the flange as it is predicted"]
    trusted: Annotated[bool, "whether frames are corrected by it"] = True
    offset_ns: Annotated[int, "the clock of the captures minus that of the screen [ns]"] = 0
    closed: Annotated[bool, "whether the gripper is closed"] = False
