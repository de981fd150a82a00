"""Where hand and buttons come from, real or simulated, and what the person is prompted to do."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Generic, TypeAlias, TypeVar

import numpy as np

from calibration.frame.fit import Matrix
from calibration.frame.simulated_person import PromptedPerson
from calibration.frame.stroke import AXES
from hw.openvr.component_reader import ComponentReader
from hw.openvr.components import ComponentReading
from hw.openvr.controller import OpenVrController
from hw.sim.operator.servoing import operator_hand
from hw.sim.operator.virtual_controller import VirtualController, rig_wiring
from tams_app.config import Config, ControllerConfig
from tams_app.errors import DeviceError
from tams_app.records import ControllerSample, Vector
from tams_app.runtime.clock import Clock, FixedRate, VirtualClock
from tams_app.units import NS_PER_S

SAMPLE_RATE_HZ = 120.0
_GIVE_UP_NS = 30 * NS_PER_S  # the simulated person does what is asked at once
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


@dataclass(frozen=True, slots=True, eq=False)
class Reach:
    """Touch one of the robot's points [m], shape (3,), and squeeze the trigger."""

    robot: Vector
    number: int  # from 1


@dataclass(frozen=True, slots=True)
class Press:
    """Press and release one part of the controller, of `hw.openvr.components.ROLES`."""

    role: str


Prompt: TypeAlias = Move | Reach | Press
SIX_DIRECTIONS = tuple(Move(axis, sign) for axis in range(3) for sign in (1, -1))


@dataclass(frozen=True, slots=True)
class Source(Generic[Reading]):
    """What is read of the controller while a person does what they are asked.

    `ask`: what the person has just been asked to do. `next`: the time [ns] and the newest reading,
    at `SAMPLE_RATE_HZ`.
    """

    ask: Callable[[Prompt], None]
    next: Callable[[], tuple[int, Reading]]


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
        components = ComponentReader(self._config.controller)
        try:
            yield self._source(lambda _: components.read())
        finally:
            components.close()

    @contextmanager
    def hand(self, controller: ControllerConfig) -> Iterator[HandSource]:
        """The hand, with the buttons mapped as `controller` says."""
        device = OpenVrController(controller, self._clock, self._note)
        device.start()

        def sample(now_ns: int) -> ControllerSample:
            if device.failure:
                raise DeviceError(device.failure)
            return device.sample(now_ns)

        try:
            yield self._source(sample)
        finally:
            device.close()

    def _source(self, read: Callable[[int], Reading]) -> Source[Reading]:
        rate = FixedRate(self._clock, SAMPLE_RATE_HZ)

        def following() -> tuple[int, Reading]:
            rate.wait()
            now_ns = self._clock.now_ns()
            return now_ns, read(now_ns)

        return Source(lambda _prompt: None, following)  # the person reads it at the terminal


class SimulatedSetup:
    """The rig's controller in the hand of a simulated person, in virtual time."""

    def __init__(self, config: Config, seed: int) -> None:
        self._config, self._seed = config, seed
        self.description = f"the simulated rig and a simulated person, seed {seed}"
        self.true_rotation: Matrix | None = np.array(operator_hand(config).rotation)
        self._clock = VirtualClock()

    @contextmanager
    def buttons(self) -> Iterator[ButtonSource]:
        person, controller = self._make(self._config)

        def read(now_ns: int) -> ComponentReading | None:
            controller.sample(now_ns)
            return controller.components()

        yield self._source(person, read)

    @contextmanager
    def hand(self, controller: ControllerConfig) -> Iterator[HandSource]:
        config = self._config.model_copy(update={"controller": controller})
        person, device = self._make(config)
        yield self._source(person, device.sample)

    def _make(self, config: Config) -> tuple[PromptedPerson, VirtualController]:
        operator = config.rig.operator
        truth = np.array(operator_hand(config).rotation)
        person = PromptedPerson(truth, operator.arm_reach_m, self._seed)
        controller = VirtualController(person, operator, self._seed, rig_wiring(config))
        controller.start()
        return person, controller

    def _source(self, person: PromptedPerson, read: Callable[[int], Reading]) -> Source[Reading]:
        asked_ns = self._clock.now_ns()

        def ask(prompt: Prompt) -> None:
            nonlocal asked_ns
            asked_ns = self._clock.now_ns()
            if isinstance(prompt, Move):
                person.begin(person.stroke(prompt.direction))
            elif isinstance(prompt, Reach):
                person.begin(person.touch(prompt.robot))
            else:
                person.begin(person.press(prompt.role))

        def following() -> tuple[int, Reading]:
            self._clock.advance_ns(round(NS_PER_S / SAMPLE_RATE_HZ))
            now_ns = self._clock.now_ns()
            if now_ns - asked_ns > _GIVE_UP_NS:
                raise DeviceError(
                    "Nothing came of what the simulated person did: look at rig.wiring and at "
                    "rig.operator in the configuration."
                )
            return now_ns, read(now_ns)

        return Source(ask, following)
