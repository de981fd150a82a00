"""The devices of a session: the simulated rig's or the hardware of the configuration."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import TypeAlias

from hw.arm import Arm
from hw.arms import arm_kind, session_boundary
from hw.camera import Camera
from tams_app.config import ArmConfig, Config
from tams_app.records import SceneTruth, TakeNote
from tams_app.robot.arm_gate import ArmGate
from tams_app.robot.listener import Listener
from tams_app.runtime.clock import Clock
from tams_app.runtime.process import HelperProcess

Truth: TypeAlias = Callable[[], SceneTruth | None]  # where things really are; None: not known now


class Devices:
    """The hardware that the configuration names; the simulated rig brings its own.

    Started before everything that uses it, closed after; the makers are called once each, and the
    session opens and closes what they return: whether a device is there shows when it is opened.
    """

    helpers: Mapping[str, HelperProcess] = {}  # processes whose end is the end of the session
    memory_name = ""  # of the rig's world

    def __init__(self, config: Config, clock: Clock) -> None:
        self._config = config
        self._clock = clock

    @property
    def truth(self) -> Truth | None:
        """Knows where things really are; None where only a person can judge the task."""
        return None

    def start(self) -> None:
        """Start what takes its time, without waiting for it."""

    def wait_ready(self) -> None:
        """Wait until arm and cameras can be reached; TamsError says what is not."""

    def arm_config(self) -> ArmConfig:
        """The configured arm, at the address where it answers."""
        return self._config.arm

    def make_arm(self) -> Arm:
        """The arm, not connected yet."""
        config = self._config
        boundary = session_boundary(config.arm, config.limits)
        kind = arm_kind(config.arm.model)
        return kind.make_arm(self.arm_config(), self._clock, config.control.rate_hz, boundary)

    def make_cameras(self, note: TakeNote) -> Sequence[Camera]:
        """One camera for each view, not started yet."""
        from hw.make_camera import make_camera  # ... and no GStreamer to get its frames

        config = self._config
        return [
            make_camera(view, config.cameras[view], config.video, self._clock, note)
            for view in config.video.views
        ]

    def put_back(self) -> None:
        """Put the block back to its start, now or once nothing is in the way; never waits.

        Beside a real arm nothing can: a person does it by hand.
        """

    def close(self) -> None:
        """Let go of everything; may be called after a failed start."""


@dataclass(frozen=True, slots=True)
class ConnectedDevices:
    """The devices that a session's engine works with, once they are there."""

    arm: Arm
    gate: ArmGate
    truth: Truth | None
    guard: Listener | None = None  # in virtual time there is none: no control loop falls silent
