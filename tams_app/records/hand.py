"""The operator's hand: what a tracked controller reports, and the pulses they feel."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum
from typing import Annotated

from tams_app.records.record import Pose


class ControllerStatus(StrEnum):
    """What the tracking runtime reports of the controller; anything but OK reads as released."""

    OK = "ok"
    DISCONNECTED = "disconnected"
    TRACKING_LOST = "tracking lost"
    STANDBY = "standby"
    DASHBOARD = "dashboard open"
    RUNTIME_QUIT = "runtime quit"
    ROLE_SWAPPED = "role swapped"  # another device plays the operator's hand now
    TRACKING_FRAME_CHANGED = "tracking frame changed"  # recentred: directions may have turned
    LINK_LOST = "link lost"  # to the computer that has the controller
    LINK_GAP = "link gap"  # nothing usable comes from there for a moment
    OPERATOR_AWAY = "operator away"  # their side has not begun yet, or has ended
    LINK_GAPS = "link gaps"  # too many, beyond what is bridged


GRIP_SHOWN_ABOVE = 0.5


@dataclass(frozen=True, slots=True)
class Presses:
    """How often each button has gone down since its device was read first."""

    grip: Annotated[int, "of the grip"] = 0
    a: Annotated[int, "of the button that closes the gripper"] = 0
    b: Annotated[int, "of the button that opens the gripper"] = 0
    menu: Annotated[int, "of the menu button"] = 0


@dataclass(frozen=True, slots=True)
class ControllerSample:
    """One reading of the tracked controller, in the tracking frame (OpenVR: y up, right-handed).

    `presses` has also those that begin and end between two samples; one of a device that does not
    count them stays as it is.
    """

    status: Annotated[ControllerStatus, "what the tracking runtime says of the controller"]
    pose: Annotated[Pose | None, "of the controller, tracking frame; null: not valid"]
    pose_ns: Annotated[int, "when the value of the pose last changed [ns]"]
    buttons_ns: Annotated[int, "until when the buttons are known [ns]"]
    trigger: Annotated[float, "how far it is pressed, 0 to 1: deadman and clutch"]
    grip: Annotated[float, "how far it is pressed, 0 to 1: toggles translation and orientation"]
    a: Annotated[bool, "button that closes the gripper"]
    b: Annotated[bool, "button that opens the gripper"]
    menu: Annotated[bool, "button; held for 1 s: confirm, clicked: emergency stop"]
    presses: Annotated[
        Presses, "how often each button has gone down since its device was read first"
    ] = Presses()

    @classmethod
    def released(
        cls,
        status: ControllerStatus,
        pose: Pose | None = None,
        pose_ns: int = 0,
        buttons_ns: int = 0,
        trigger: float = 0.0,
    ) -> ControllerSample:
        """No button is down, unless it is the trigger; such as one of a controller that is away."""
        return cls(status, pose, pose_ns, buttons_ns, trigger, 0.0, a=False, b=False, menu=False)

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
    LINK_HOLD = "link hold"
    LINK_FAULT = "link fault"

    @property
    def is_fault(self) -> bool:
        """True if the arm stays stopped until they confirm."""
        return self in (Haptic.FAULT, Haptic.LINK_FAULT)
