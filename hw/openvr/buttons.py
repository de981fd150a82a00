"""What is read of a controller's buttons, and the interface of the two ways to read them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from hw.openvr.haptics import Vibration


@dataclass(frozen=True, slots=True)
class Buttons:
    """One complete reading: trigger and grip 0..1."""

    trigger: float = 0.0
    grip: float = 0.0
    a: bool = False
    b: bool = False
    menu: bool = False


class ButtonSource(Protocol):
    """SteamVR Input's actions, or the legacy controller state."""

    pulse_every_s: float | None  # how often a pulse must be repeated to vibrate on; None: never

    @property
    def unread(self) -> tuple[str, ...]:
        """What the last `read` could not read."""

    def read(self, device: int, controller_type: str) -> Buttons | None:
        """The buttons now; None unless every one of them is there and this process may have it."""

    def vibrate(self, device: int, vibration: Vibration) -> None:
        """Let the controller vibrate; does not wait until it has."""
