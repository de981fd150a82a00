"""The arm: its kinematics, what its controller reports, and how its command connection does."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated, Protocol

import numpy as np
from numpy.typing import NDArray

from tams_app.records.record import Pose, Record, Vector


class ArmKinematics(Protocol):
    """The kinematics of an arm with its configured tool; base frame with z up."""

    @property
    def joint_speed_limits(self) -> Vector:
        """Largest joint speeds [rad/s], shape (6,)."""

    @property
    def joint_ranges(self) -> Sequence[tuple[float, float]]:
        """The lowest and the highest angle of each of six joints [rad]."""

    def tcp_pose(self, joints: Vector) -> Pose:
        """Forward kinematics.

        Args:
            joints: joint angles [rad], shape (6,).

        Returns:
            The TCP in the base frame: position [m] and rotation.
        """

    def jacobian(self, joints: Vector) -> NDArray[np.float64]:
        """The geometric Jacobian in the base frame.

        Args:
            joints: joint angles [rad], shape (6,).

        Returns:
            Shape (6, 6): from joint speeds [rad/s] to the TCP's twist (vx, vy, vz [m/s], wx, wy,
            wz [rad/s]).
        """


class ServoMode(StrEnum):
    """What kind of motion an arm's controller takes."""

    VELOCITY = "velocity"  # twists with a deadman time in the controller: what TAMS uses
    POSE = "pose"  # small absolute steps: another program's, or of a session up to version 2


class Activity(StrEnum):
    """What the arm's controller reports that the arm is doing."""

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

    `text` is a clause without a full stop: the number as the manual prints it, what it means and
    what to do about it, such as "C31 (collision): remove what it hit".
    """

    code: Annotated[int, "number of the arm's own controller, never 0"]
    text: Annotated[str, "what it means and what to do about it"]

    @property
    def sentence(self) -> str:
        """The fault in one sentence."""
        return f"The arm stopped with error {self.text}."


@dataclass(frozen=True, slots=True)
class ArmState:
    """The arm's last report, in the words that all arms share; nothing senses the fingers."""

    received_ns: Annotated[int, "when the report arrived [ns]"]
    joints: Annotated[Vector, "joint angles, base to flange [rad]"]
    tcp: Annotated[Pose, "the tool centre point, base frame (z up)"]
    activity: Annotated[Activity, "what the arm's controller says it does"]
    servo: Annotated[
        ServoMode | None, "servo mode: velocity or pose; null: the controller is in neither"
    ]
    fault: Annotated[ArmFault | None, "what the arm's controller reports; null: no error"]
    gripper_closed: Annotated[
        bool | None, "gripper command that its outputs show; null: none, or not known"
    ]
    warning_code: Annotated[int, "number of the arm's own controller; 0: none"] = 0
    hottest_motor_c: Annotated[int | None, "of the joints' motors [°C]; null: not known"] = None


class LinkFault(StrEnum):
    """What kind of failure ended the arm's command link."""

    NONE = ""
    LOST = "lost"  # nothing gets through
    REFUSED = "refused"  # the arm answers, and refuses
    GRIPPER = "gripper"  # the tool's outputs do not do what was commanded


@dataclass(frozen=True, slots=True)
class CommandLink:
    """Health of the arm's command connection, as its sender sees it."""

    sent: Annotated[int, "commands handed to the wire since the start"]
    acknowledged_ns: Annotated[int, "when the last reply to a command arrived [ns]"]
    round_trip_ns: Annotated[int, "of the last acknowledged command [ns]"]
    slow: Annotated[int, "replies later than one control period, since the start"]
    failure: Annotated[str, "why commands do not get through; empty: they do"]
    fault: Annotated[
        LinkFault, "kind of failure of the command connection; empty exactly if `failure` is"
    ] = LinkFault.NONE


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
    camera_fits: Annotated[
        bool, "whether the camera on the arm is where its calibration has it, by its frames so far"
    ] = True
    commanded: Annotated[
        Pose | None, "of the flange where all samples sent so far lead; null: not known"
    ] = None
    then_joints: Annotated[
        Vector | None, "joint angles then, base to flange [rad]; null: not known"
    ] = None
    now_joints: Annotated[Vector | None, "as they are predicted [rad]; null: not known"] = None
