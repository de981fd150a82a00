"""What a session is built on: the simulated rig's devices or the hardware of the configuration."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Protocol

from hw.arm import Arm
from hw.camera import Camera
from hw.controller import Controller
from tams_app.config import ArmConfig
from tams_app.records import SceneTruth
from tams_app.runtime.process import HelperProcess
from tams_app.session.arm_gate import ArmGate
from tams_app.session.listener import Listener

Note = Callable[[str, str], None]  # level and sentence, for the log and the console


class Devices(Protocol):
    """Started before everything that uses them, closed after; the makers are called once each."""

    @property
    def helpers(self) -> Mapping[str, HelperProcess]:
        """Processes whose end is the end of the session."""

    @property
    def truth(self) -> Callable[[], SceneTruth | None] | None:
        """Tells where things really are; None where only a person can judge the task."""

    def start(self) -> None:
        """Start what takes its time, without waiting for it."""

    def wait_ready(self) -> None:
        """Wait until arm and cameras can be reached; TamsError says what is not."""

    def arm_config(self) -> ArmConfig:
        """The configured arm, at the address where it answers."""

    def make_arm(self) -> Arm:
        """The arm, not connected yet."""

    def make_controller(self, note: Note) -> Controller:
        """The tracked controller, not started yet."""

    def make_cameras(self, note: Note) -> list[Camera]:
        """One camera for each view, not started yet."""

    def close(self) -> None:
        """Let go of everything; may be called after a failed start."""


@dataclass(frozen=True, slots=True)
class ConnectedDevices:
    """The devices that a session's engine works with, once they are there."""

    arm: Arm
    gate: ArmGate
    controller: Controller
    truth: Callable[[], SceneTruth | None] | None
    guard: Listener | None = None  # in virtual time there is none: no control loop falls silent
