"""How long a trial took that nobody's simulator watched, from its log."""

from __future__ import annotations

from tams_app.recording import SessionLog
from tams_app.records import Phase
from tams_app.runtime.clock import NS_PER_S
from tams_app.teleop.safety import ArmingState


def completion_time_s(log: SessionLog) -> float | None:
    """From the first engagement to the last opening of the gripper (docs/GLOSSARY.md).

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
