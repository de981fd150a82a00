"""A trial's log as the verdict needs it: the time, and the experimenter's marks."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from tams_app.recording import LOG_NAME, SessionLog, read_log
from tams_app.records import Phase
from tams_app.teleop.safety import ArmingState
from tams_app.units import NS_PER_S

DROPS_FACT, PLACED_FACT = "drops_counted", "placed_marked"
MAX_DROPS = 99


@dataclass(frozen=True, slots=True)
class Marks:
    """The trial's marks before the experimenter is asked.

    time_s: completion time. drops: None if none was counted. placed: whether the trial was ended by
    the key for that.
    """

    time_s: float | None = None
    drops: int | None = None
    placed: bool = False


def marks_in(folder: Path) -> Marks:
    """Of a trial's folder, which may have no log."""
    path = folder / LOG_NAME
    return marks_of(read_log(path)) if path.is_file() else Marks()


def marks_of(log: SessionLog) -> Marks:
    """The marks in a log."""
    counted = log.facts.get(DROPS_FACT, "")
    drops = min(int(counted), MAX_DROPS) if counted.isdecimal() else None
    return Marks(completion_time_s(log), drops, PLACED_FACT in log.facts)


def completion_time_s(log: SessionLog) -> float | None:
    """From the first engagement to the last opening of the gripper.

    None where the arm was never engaged or the gripper not opened after that. Whether the block
    was placed by that opening only a person can say.
    """
    engaged_ns = min(
        (tick.finished_ns for tick in log.ticks if tick.arming == ArmingState.ENGAGED.value),
        default=None,
    )
    if engaged_ns is None:
        return None
    opened_ns = [
        change.t_ns
        for change in log.phases
        if change.phase is Phase.RELEASE and change.t_ns > engaged_ns
    ]
    return round((max(opened_ns) - engaged_ns) / NS_PER_S, 3) if opened_ns else None
