"""Where hand and buttons come from: the devices of the configuration, or the simulated rig."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from typing import Generic, Protocol, TypeVar

import numpy as np

from calibration.frame.person import PromptedPerson
from calibration.frame.prompts import Prompt
from calibration.frame.rotation import Matrix
from hw.openvr.components import ComponentReading
from hw.openvr.controller import OpenVrController
from hw.openvr.legacy import ComponentReader
from hw.sim.operator.servoing import operator_hand
from hw.sim.operator.virtual_controller import VirtualController, rig_wiring
from tams_app.config import Config, ControllerConfig
from tams_app.errors import DeviceError
from tams_app.records import ControllerSample
from tams_app.runtime.clock import NS_PER_S, Clock, FixedRate, VirtualClock

_GIVE_UP_NS = 30 * NS_PER_S  # for a simulated person, who does what is asked at once
SAMPLE_RATE_HZ = 120.0
Reading = TypeVar("Reading")


class HandSource(Protocol):
    """The controller's pose and trigger."""

    def ask(self, prompt: Prompt) -> None:
        """What the person has just been asked to do."""

    def next(self) -> tuple[int, ControllerSample]:
        """The time [ns] and the newest sample, at `SAMPLE_RATE_HZ`."""


class ButtonSource(Protocol):
    """All components of the controller."""

    def ask(self, prompt: Prompt) -> None:
        """What the person has just been asked to do."""

    def next(self) -> tuple[int, ComponentReading | None]:
        """The time [ns] and the newest reading, None while there is none."""


class Setup(Protocol):
    """What is to be calibrated."""

    description: str
    true_rotation: Matrix | None  # where it is known, which is in simulation only

    def buttons(self) -> AbstractContextManager[ButtonSource]:
        """The components; closed before `hand` is opened."""

    def hand(self, controller: ControllerConfig) -> AbstractContextManager[HandSource]:
        """The hand, with the buttons mapped as `controller` says."""


class LiveSetup:
    """The configured controller over OpenVR, in a person's hand. No arm is connected."""

    description = "a person with the controller"
    true_rotation: Matrix | None = None

    def __init__(self, config: Config, clock: Clock, note: Callable[[str, str], None]) -> None:
        self._config, self._clock, self._note = config, clock, note

    @contextmanager
    def buttons(self) -> Iterator[ButtonSource]:
        components = ComponentReader(self._config.controller)
        try:
            yield _Live(self._clock, lambda _: components.read())
        finally:
            components.close()

    @contextmanager
    def hand(self, controller: ControllerConfig) -> Iterator[HandSource]:
        device = OpenVrController(controller, self._clock, self._note)
        device.start()

        def sample(now_ns: int) -> ControllerSample:
            if device.failure:
                raise DeviceError(device.failure)
            return device.sample(now_ns)

        try:
            yield _Live(self._clock, sample)
        finally:
            device.close()


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

        yield _Simulated(self._clock, person, read)

    @contextmanager
    def hand(self, controller: ControllerConfig) -> Iterator[HandSource]:
        config = self._config.model_copy(update={"controller": controller})
        person, device = self._make(config)
        yield _Simulated(self._clock, person, device.sample)

    def _make(self, config: Config) -> tuple[PromptedPerson, VirtualController]:
        operator = config.rig.operator
        truth = np.array(operator_hand(config).rotation)
        person = PromptedPerson(truth, operator.arm_reach_m, self._seed)
        controller = VirtualController(person, operator, self._seed, rig_wiring(config))
        controller.start()
        return person, controller


class _Live(Generic[Reading]):
    def __init__(self, clock: Clock, read: Callable[[int], Reading]) -> None:
        self._clock, self._read = clock, read
        self._rate = FixedRate(clock, SAMPLE_RATE_HZ)

    def ask(self, prompt: Prompt) -> None:
        """The person reads it at the desk."""

    def next(self) -> tuple[int, Reading]:
        self._rate.wait()
        now_ns = self._clock.now_ns()
        return now_ns, self._read(now_ns)


class _Simulated(Generic[Reading]):
    def __init__(
        self, clock: VirtualClock, person: PromptedPerson, read: Callable[[int], Reading]
    ) -> None:
        self._clock, self._person, self._read = clock, person, read
        self._asked_ns = clock.now_ns()

    def ask(self, prompt: Prompt) -> None:
        self._person.ask(prompt)
        self._asked_ns = self._clock.now_ns()

    def next(self) -> tuple[int, Reading]:
        self._clock.advance_ns(round(NS_PER_S / SAMPLE_RATE_HZ))
        now_ns = self._clock.now_ns()
        if now_ns - self._asked_ns > _GIVE_UP_NS:
            raise DeviceError(
                "Nothing came of what the simulated person did: look at rig.wiring and at "
                "rig.operator in the configuration."
            )
        return now_ns, self._read(now_ns)
