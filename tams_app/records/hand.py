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


GRIP_SHOWN_ABOVE = 0.5


@dataclass(frozen=True, slots=True)
class Presses:
    """How often each button has gone down since its device was read first."""

    grip: int = 0
    a: int = 0
    b: int = 0
    menu: int = 0


@dataclass(frozen=True, slots=True)
class ControllerSample:
    """One reading of the tracked controller, in the tracking frame (OpenVR: y up, right-handed).

    `pose` is None when the runtime calls it invalid. `pose_ns`: when the pose's value last
    changed; `buttons_ns`: until when the buttons are known. `presses` has also those that begin and
    end between two samples; one of a device that does not count them stays as it is.
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
    presses: Presses = Presses()

    @property
    def pressed(self) -> tuple[str, ...]:
        """Names of the buttons that are down, other than the trigger."""
        down = {
            "grip": self.grip > GRIP_SHOWN_ABOVE,
            "A": self.a,
            "B": self.b,
            "menu": self.menu,
        }
        return tuple(name for name, is_down in down.items() if is_down)


class Haptic(StrEnum):
    """The pulses the operator feels."""

    ENGAGE = "engage"
    RELEASE = "release"
    LIMIT = "limit"
    FAULT = "fault"
