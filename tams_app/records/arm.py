"""The arm: what its controller reports, and how its command connection does."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from tams_app.records.geometry import Pose, Vector


class ServoMode(StrEnum):
    """What kind of motion an arm's controller takes."""

    VELOCITY = "velocity"  # twists with a deadman time in the controller: what TAMS uses
    POSE = "pose"  # small absolute steps: another program's, or of a session up to version 2


class Activity(StrEnum):
    """What the arm's controller says that the arm is doing."""

    MOVING = "moving"
    IDLE = "idle"  # stands, and takes motion commands
    PAUSED = "paused"
    STOPPED = "stopped"  # takes no motion command until it is enabled

    @property
    def is_halted(self) -> bool:
        """Whether motion commands are not followed."""
        return self in (Activity.PAUSED, Activity.STOPPED)


@dataclass(frozen=True, slots=True)
class ArmFault:
    """An error that the arm's controller reports.

    code: the controller's own number, never 0.
    text: a clause without a full stop: the number as the manual prints it, what it means and what
        to do about it, such as "C31 (collision): remove what it hit".
    """

    code: int
    text: str

    @property
    def sentence(self) -> str:
        """The fault in one sentence."""
        return f"The arm stopped with error {self.text}."


@dataclass(frozen=True, slots=True)
class ArmState:
    """The arm's last report, in the words that all arms share.

    received_ns: when it arrived [ns], monotonic clock.
    joints: joint angles [rad], shape (6,).
    tcp: the tool centre point in the base frame (z up) [m].
    servo: the servo mode that the controller is in; None in any other mode.
    fault: what the controller reports, None if it has no error.
    gripper_closed: the last command that was acknowledged (nothing senses the fingers); None
        until one was read back or sent.
    warning_code: the controller's own number, kept in the log; 0 for none.
    """

    received_ns: int
    joints: Vector
    tcp: Pose
    activity: Activity
    servo: ServoMode | None
    fault: ArmFault | None
    gripper_closed: bool | None
    warning_code: int = 0


class LinkFault(StrEnum):
    """What kind of failure ended the arm's command link."""

    NONE = ""
    LOST = "lost"  # nothing gets through
    REFUSED = "refused"  # the arm answers, and refuses
    GRIPPER = "gripper"  # the tool's outputs do not do what was commanded


@dataclass(frozen=True, slots=True)
class CommandLink:
    """Health of the arm's command connection, as its sender sees it."""

    sent: int  # commands handed to the wire
    acknowledged_ns: int  # when the last reply arrived
    round_trip_ns: int  # of the last acknowledged command
    slow: int  # replies later than one control period
    failure: str  # "" or one sentence: why commands no longer get through
    fault: LinkFault = LinkFault.NONE  # NONE exactly when `failure` is ""
