"""What a person is prompted to do, and where their hand and buttons are read."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Generic, TypeAlias, TypeVar

import numpy as np

from calibration.frame.fit import Matrix
from calibration.frame.stroke import AXES
from hw.openvr.components import ComponentReading
from hw.openvr.controller import OpenVrController
from hw.openvr.devices import ComponentReader
from tams_app.config import Config, ControllerConfig
from tams_app.errors import DeviceError
from tams_app.records import ControllerSample, Vector
from tams_app.runtime.clock import Clock, FixedRate

SAMPLE_RATE_HZ = 120.0
SHOW_EVERY = 12  # samples: ten times a second
_MEANING = {
    "+x": "away from the robot's base",
    "−x": "towards the robot's base",
    "+y": "to the robot's left",
    "−y": "to the robot's right",
    "+z": "up",
    "−z": "down",
}
Reading = TypeVar("Reading")


@dataclass(frozen=True, slots=True)
class Move:
    """Hold the trigger and move the hand along one of the robot's axes, `sign` 1 or -1."""

    axis: int
    sign: int = 1

    @property
    def name(self) -> str:
        return f"{'+' if self.sign > 0 else '−'}{AXES[self.axis]}"

    @property
    def meaning(self) -> str:
        """The direction in words, as seen from the robot."""
        return _MEANING[self.name]

    @property
    def direction(self) -> Vector:
        """Unit, in the arm's base frame, shape (3,)."""
        return np.asarray(self.sign * np.eye(3)[self.axis])


@dataclass(frozen=True, slots=True)
class Press:
    """Press and release one part of the controller, of `hw.openvr.components.ROLES`."""

    role: str


Prompt: TypeAlias = Move | Press
SIX_DIRECTIONS = tuple(Move(axis, sign) for axis in range(3) for sign in (1, -1))


class Source(Generic[Reading]):
    """What is read of the controller while a person does what they are asked."""

    def __init__(self, clock: Clock, read: Callable[[int], Reading]) -> None:
        """`read`: the newest reading at a time [ns]."""
        self._clock, self._read = clock, read
        self._rate = FixedRate(clock, SAMPLE_RATE_HZ)

    def ask(self, prompt: Prompt) -> None:
        """Take note of what the person has just read at the terminal."""

    def next(self) -> tuple[int, Reading]:
        """The time [ns] and the newest reading, at `SAMPLE_RATE_HZ`."""
        self._rate.wait()
        now_ns = self._clock.now_ns()
        return now_ns, self._read(now_ns)


HandSource: TypeAlias = Source[ControllerSample]  # pose and trigger
ButtonSource: TypeAlias = Source[ComponentReading | None]  # all components; None: not there yet


class LiveSetup:
    """The configured controller over OpenVR, in a person's hand. No arm is connected."""

    description = "a person with the controller"
    true_rotation: Matrix | None = None  # known in simulation only

    def __init__(self, config: Config, clock: Clock, note: Callable[[str, str], None]) -> None:
        self._config, self._clock, self._note = config, clock, note

    @contextmanager
    def buttons(self) -> Iterator[ButtonSource]:
        """The components; closed before `hand` is opened."""
        with closing(ComponentReader(self._config.controller)) as components:
            yield Source(self._clock, lambda _: components.read())

    @contextmanager
    def hand(self, controller: ControllerConfig) -> Iterator[HandSource]:
        """The hand, with the buttons mapped as `controller` says."""
        device = OpenVrController(controller, self._clock, self._note)
        device.start()

        def sample(now_ns: int) -> ControllerSample:
            if device.failure:
                raise DeviceError(device.failure)
            return device.sample(now_ns)

        with closing(device):
            yield Source(self._clock, sample)
