"""A person who moves the rig's controller as they are asked to, about as well as people do.

They know where the robot's axes point, but not quite: each stroke sets out in a slightly wrong
direction and is slightly bent. The hand trembles and the muscles add noise (`sim.operator.hand`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calibration.frame.sources import (
    ButtonSource,
    HandSource,
    Move,
    Prompt,
    Read,
    Reading,
    Source,
)
from hw.openvr.components import ComponentReading
from hw.sim.operator.hand import Hand, HandCommand, ThumbButton
from hw.sim.operator.servoing import operator_hand
from hw.sim.operator.virtual_controller import VirtualController, rig_wiring
from tams_app.config import Config, ControllerConfig
from tams_app.errors import DeviceError
from tams_app.records import Haptic, Vector
from tams_app.rotation import Rotation
from tams_app.runtime.clock import VirtualClock
from tams_app.units import NS_PER_MS, NS_PER_S

# With something straight to move along, such as a table's edge: assumed, not measured.
DIRECTION_ERROR_DEG = 1.0  # per axis, each stroke anew
BOW = 0.02  # of the length, each stroke anew
MOTOR_NOISE = 0.02  # along an edge; 0.05 to 0.15 in free air (hw.sim.operator.participant)

_TRAVEL = 1.5  # of the arm's reach: a stroke
_LEAN_M = 0.6  # from rest, with the whole body
_SPEED_M_S = 0.22
_RETURN_SPEED_M_S = 0.5
_GAIN_PER_S = 3.5
_ARRIVED_M = 0.004
_PAUSE_NS = 300 * NS_PER_MS
_HOLD_NS = 500 * NS_PER_MS
_LONGEST_NS = 5 * NS_PER_S  # for one movement, should it never arrive
_GIVE_UP_NS = 30 * NS_PER_S  # what is asked is done at once

Routine: TypeAlias = Iterator[HandCommand]


class PromptedPerson:
    """Holds a controller; deterministic from seed, requests and times."""

    def __init__(self, hand_rotation: NDArray[np.float64], reach_m: float, seed: int) -> None:
        """`hand_rotation`: from the tracking frame to the arm's base frame, as it truly is."""
        self._random = np.random.default_rng([seed, 0xCA1])
        self.hand = Hand(self._random, _LEAN_M, motor_noise=MOTOR_NOISE)
        self._to_hand = hand_rotation.T
        self._travel = _TRAVEL * reach_m
        self._now_ns = 0
        self._last_ns: int | None = None
        self._routine: Routine = iter(())

    def begin(self, routine: Routine) -> None:
        """Do one of `stroke` and `press` next, in place of what was begun before."""
        self._routine = routine

    def step(self, now_ns: int) -> None:
        if self._last_ns is None:
            self._last_ns = now_ns
        elapsed_s = (now_ns - self._last_ns) / NS_PER_S
        self._last_ns = self._now_ns = now_ns
        self.hand.step(next(self._routine, HandCommand.still()), elapsed_s)

    def feel(self, haptic: Haptic) -> None:
        """There are no pulses here."""

    # --- what the person does --------------------------------------------------------------------

    def stroke(self, direction: Vector) -> Routine:
        """Move the hand along it (unit, in the arm's base frame), the trigger held.

        From one side to the other, a little wrong and a little bent.
        """
        direction = self._to_hand @ direction
        wrong = self._random.normal(0.0, math.radians(DIRECTION_ERROR_DEG), 3)
        along = Rotation.from_rotvec(wrong).apply(direction)
        aside = np.cross(along, self._random.standard_normal(3))
        aside *= self._random.normal(0.0, BOW) * self._travel / np.linalg.norm(aside)
        yield from self._go_to(-0.5 * self._travel * along)
        yield from self._wait(_PAUSE_NS)
        yield from self._wait(_PAUSE_NS, HandCommand.still(trigger=True))
        start = self.hand.arm.offset.copy()
        travelled, deadline_ns = 0.0, self._now_ns + _LONGEST_NS
        while travelled < self._travel - _ARRIVED_M and self._now_ns < deadline_ns:
            travelled = float((self.hand.arm.offset - start) @ along)
            share = min(1.0, max(0.0, travelled / self._travel))
            speed = min(_SPEED_M_S, _GAIN_PER_S * (self._travel - travelled))
            slope = 4 * (1 - 2 * share) / self._travel  # of a parabola of height 1
            yield HandCommand(speed * (along + slope * aside), np.zeros(3), trigger=True)
        yield from self._wait(_PAUSE_NS, HandCommand.still(trigger=True))
        yield from self._wait(_PAUSE_NS)

    def press(self, role: str) -> Routine:
        """Press and release one part of the controller, of `hw.openvr.components.ROLES`."""
        button = None if role in ("trigger", "grip") else ThumbButton(role)
        pressed = HandCommand.still(trigger=role == "trigger", grip=role == "grip", button=button)
        yield from self._wait(_PAUSE_NS)
        yield from self._wait(_HOLD_NS, pressed)
        yield from self._wait(_PAUSE_NS)

    def _go_to(self, offset: Vector) -> Routine:
        deadline_ns = self._now_ns + _LONGEST_NS
        while self._now_ns < deadline_ns:
            gap = offset - self.hand.arm.offset
            distance = float(np.linalg.norm(gap))
            if distance < _ARRIVED_M:
                return
            speed = min(_RETURN_SPEED_M_S, _GAIN_PER_S * distance)
            yield HandCommand(gap * (speed / distance), np.zeros(3))

    def _wait(self, duration_ns: int, wish: HandCommand | None = None) -> Routine:
        until_ns = self._now_ns + duration_ns
        while self._now_ns < until_ns:
            yield wish or HandCommand.still()


class PromptedSource(Source[Reading]):
    """What is read while a simulated person, in virtual time, begins what they are asked."""

    def __init__(self, clock: VirtualClock, read: Read[Reading], person: PromptedPerson) -> None:
        super().__init__(clock, read)
        self._person, self._asked_ns = person, clock.now_ns()

    def ask(self, prompt: Prompt) -> None:
        self._asked_ns, person = self._clock.now_ns(), self._person
        if isinstance(prompt, Move):
            person.begin(person.stroke(prompt.direction))
        else:
            person.begin(person.press(prompt))

    def next(self) -> tuple[int, Reading]:
        now_ns, reading = super().next()
        if now_ns - self._asked_ns > _GIVE_UP_NS:
            raise DeviceError(
                "Nothing came of what the simulated person did: look at rig.wiring and at "
                "rig.operator in the configuration."
            )
        return now_ns, reading


class SimulatedSetup:
    """The rig's controller in the hand of a simulated person, in virtual time."""

    def __init__(self, config: Config, seed: int) -> None:
        self._config, self._seed = config, seed
        self.description = f"the simulated rig and a simulated person, seed {seed}"
        self._true_rotation = np.array(operator_hand(config).rotation)
        self._clock = VirtualClock()

    @contextmanager
    def buttons(self) -> Iterator[ButtonSource]:
        person, controller = self._make(self._config)

        def read(now_ns: int) -> ComponentReading | None:
            controller.sample(now_ns)
            return controller.components()

        yield PromptedSource(self._clock, read, person)

    @contextmanager
    def hand(self, controller: ControllerConfig) -> Iterator[HandSource]:
        config = self._config.model_copy(update={"controller": controller})
        person, device = self._make(config)
        yield PromptedSource(self._clock, device.sample, person)

    def _make(self, config: Config) -> tuple[PromptedPerson, VirtualController]:
        operator = config.rig.operator
        person = PromptedPerson(self._true_rotation, operator.arm_reach_m, self._seed)
        controller = VirtualController(person, operator, self._seed, rig_wiring(config))
        controller.start()
        return person, controller
