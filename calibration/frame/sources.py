"""What a person is prompted to do, where their hand and buttons are read, and what is a stroke."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from typing import Generic, TypeAlias, TypeVar

import numpy as np

from calibration.frame.fit import AXES, BeginAgainError, Matrix, RefusedError
from hw.openvr.components import ComponentReading
from hw.openvr.controller import OpenVrController
from hw.openvr.devices import ComponentReader
from tams_app.config import Config, ControllerConfig
from tams_app.errors import DeviceError
from tams_app.records import ControllerSample, ControllerStatus, TakeNote, Vector
from tams_app.runtime.clock import Clock, FixedRate
from tams_app.teleop.clutch import Clutch

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
Read: TypeAlias = Callable[[int], Reading]  # the newest reading at a time [ns]


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


Prompt: TypeAlias = Move | str
"""A stroke, or the part of the controller to press and release, of `hw.openvr.components.ROLES`."""
SIX_DIRECTIONS = tuple(Move(axis, sign) for axis in range(3) for sign in (1, -1))


class Source(Generic[Reading]):
    """What is read of the controller while a person does what they are asked."""

    def __init__(self, clock: Clock, read: Read[Reading]) -> None:
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

    def __init__(self, config: Config, clock: Clock, note: TakeNote) -> None:
        self._config, self._clock, self._note = config, clock, note

    @contextmanager
    def buttons(self) -> Iterator[ButtonSource]:
        """The components; closed before `hand` is opened."""
        with closing(ComponentReader(self._config.controller)) as components:

            def read(_now_ns: int) -> ComponentReading | None:
                return components.read()

            yield Source(self._clock, read)

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


class StrokeCapture:
    """Collects while the trigger is held, with the clutch's own rules for what that means."""

    def __init__(self, config: Config) -> None:
        self._clutch = Clutch(config.freshness.buttons_ms * 1e6)
        self._places: list[Vector] | None = None  # None: the trigger is up
        self._pose_ns = 0

    @property
    def so_far(self) -> Matrix | None:
        """Where the hand was since the squeeze [m], shape (n, 3); None while the trigger is up."""
        return None if self._places is None else np.array(self._places).reshape(-1, 3)

    def take(self, sample: ControllerSample, now_ns: int) -> Matrix | None:
        """Take in the newest sample; all places at the release [m], shape (n, 3), else None.

        RefusedError if the tracking was lost meanwhile, BeginAgainError if its frame changed.
        """
        buttons = self._clutch.update(sample, now_ns)
        if sample.status is ControllerStatus.TRACKING_FRAME_CHANGED:
            self._places = None
            raise BeginAgainError(
                "The headset was recentred, so that nothing measured before holds any longer: "
                "let the trigger go for a second, and begin anew."
            )
        if self._places is not None and (
            sample.status is not ControllerStatus.OK or sample.pose is None
        ):
            self._places = None
            raise RefusedError(
                f"The controller was lost while the trigger was held ({sample.status.value}): "
                "do it again where it is tracked."
            )
        if buttons.press:
            self._places = []
        if self._places is None:
            return None
        if not buttons.pressed:
            done, self._places = self.so_far, None
            return done
        if sample.pose is not None and sample.pose_ns > self._pose_ns:
            self._places.append(sample.pose.position)
            self._pose_ns = sample.pose_ns
        return None
