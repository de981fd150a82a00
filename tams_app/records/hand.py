"""The operator's hand: what a tracked controller says, and the pulses they feel."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from tams_app.records.geometry import Pose


class ControllerStatus(StrEnum):
    """What the tracking runtime says of the controller; anything but OK reads as released."""

    OK = "ok"
    DISCONNECTED = "disconnected"
    TRACKING_LOST = "tracking lost"
    STANDBY = "standby"
    DASHBOARD = "dashboard open"
    RUNTIME_QUIT = "runtime quit"
    ROLE_SWAPPED = "role swapped"  # another device plays the operator's hand now
    TRACKING_FRAME_CHANGED = "tracking frame changed"  # recentred: directions may have turned
    LINK_LOST = "link lost"  # to the computer that has the controller
    LINK_GAPS = "link gaps"  # too many, beyond what is bridged


@dataclass(frozen=True, slots=True)
class ControllerSample:
    """One reading of the tracked controller, in the tracking frame (OpenVR: y up, right-handed).

    `pose` is None when the runtime calls it invalid. `pose_ns`: when the pose's value last
    changed; `buttons_ns`: the last successful, active read of the buttons.
    """

    status: ControllerStatus
    pose: Pose | None
    pose_ns: int
    buttons_ns: int
    trigger: float  # 0..1, deadman and clutch
    grip: float  # 0..1, toggles translation/orientation on its edge
    a: bool  # closes the gripper on its edge
    b: bool  # opens the gripper on its edge
    menu: bool  # held 1 s: confirm; clicked: emergency stop


class Haptic(StrEnum):
    """The pulses the operator feels."""

    ENGAGE = "engage"
    RELEASE = "release"
    LIMIT = "limit"
    FAULT = "fault"
