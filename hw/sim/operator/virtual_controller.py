"""Tracked controller of the simulated rig: a simulated hand behind a sensor model.

No threads and no clock: `sample` moves the hand on to the given time. The same seed and the same
sequence of times, percepts and pulses give the same samples.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from hw.controller import Controller
from hw.openvr.components import (
    COMPONENTS,
    ROLES,
    ComponentReading,
    RoleMap,
    configured_role_map,
    role_map,
)
from hw.sim.operator.hand import Hand, ThumbButton
from tams_app.config import Config, OperatorConfig
from tams_app.errors import ConfigError
from tams_app.presses import PressCounter
from tams_app.records import ControllerSample, ControllerStatus, Haptic, Pose
from tams_app.rotation import Rotation
from tams_app.units import NS_PER_MS

# Runtimes fuse cameras with inertial sensors: the error wanders rather than jumps at each sample.
NOISE_CORRELATION_NS = 200 * NS_PER_MS


class Holder(Protocol):
    """The one who holds the controller."""

    @property
    def hand(self) -> Hand: ...

    def step(self, now_ns: int) -> None:
        """Move the hand on to `now_ns`, which never goes back."""

    def feel(self, haptic: Haptic) -> None:
        """A pulse in the hand."""


class Wiring:
    """A controller whose parts may move other components than the mapping believes."""

    def __init__(self, controller_type: str, hand: str, moves: RoleMap, plays: RoleMap) -> None:
        """`moves`: the component that a press of each part moves; `plays`: the mapping's."""
        self._controller_type = controller_type
        self._paths = tuple(component.path for component in COMPONENTS[controller_type][hand])
        self._moves, self._plays = moves, plays

    def reading(self, pressed: Mapping[str, float]) -> ComponentReading:
        """Every component while the parts (`ROLES`) are pressed so far, 0..1."""
        values = dict.fromkeys(self._paths, 0.0)
        for role, value in pressed.items():
            component = self._moves[role]
            values[component.path] = value if component.is_analog else float(value > 0.5)
        return ComponentReading(self._controller_type, values)

    def roles(self, reading: ComponentReading) -> dict[str, float]:
        """The mapping of a reading: role → 0..1."""
        return {role: reading.values[self._plays[role].path] for role in ROLES}


class VirtualController(Controller):
    """A controller held by `operator`, with tracking noise."""

    def __init__(self, operator: Holder, config: OperatorConfig, seed: int, wiring: Wiring) -> None:
        self._counter = PressCounter()
        self.operator = operator
        self._wiring = wiring
        self._random = np.random.default_rng([seed, 0x5E450])
        self._noise_sigma = np.repeat(
            (config.position_noise_mm / 1000.0, np.radians(config.rotation_noise_deg)), 3
        )
        self._noise: NDArray[np.float64] = np.zeros(6)
        self._noise_ns = 0
        self._started = False
        self._last = ControllerSample.released(ControllerStatus.DISCONNECTED)

    def start(self) -> None:
        self._started = True

    def sample(self, now_ns: int) -> ControllerSample:
        if not self._started:
            pose_ns, buttons_ns = self._last.pose_ns, self._last.buttons_ns
            return ControllerSample.released(
                ControllerStatus.DISCONNECTED, None, pose_ns, buttons_ns
            )
        self.operator.step(now_ns)
        self._last = self._read(now_ns)
        return self._last

    def components(self) -> ComponentReading:
        """All that could be read of the newest sample's controller."""
        return self._wiring.reading(self._pressed())

    def pulse(self, haptic: Haptic) -> None:
        if self._started:
            self.operator.feel(haptic)

    def close(self) -> None:
        self._started = False

    def _read(self, now_ns: int) -> ControllerSample:
        pressed = self._wiring.roles(self.components())
        a, b, menu = (pressed[role] > 0.5 for role in ("a", "b", "menu"))
        measured = self.operator.hand.pose() + self._wander(now_ns)
        return ControllerSample(
            ControllerStatus.OK,
            Pose(measured[:3], Rotation.from_rotvec(measured[3:])),
            now_ns,
            now_ns,
            trigger=pressed["trigger"],
            grip=pressed["grip"],
            a=a,
            b=b,
            menu=menu,
            presses=self._counter.update(pressed["grip"], a, b, menu),
        )

    def _pressed(self) -> dict[str, float]:
        """The pull of each button, 0..1."""
        hand = self.operator.hand
        buttons = {button.value: float(hand.button is button) for button in ThumbButton}
        return {"trigger": hand.trigger, "grip": hand.grip, **buttons}

    def _wander(self, now_ns: int) -> NDArray[np.float64]:
        """The tracking error now: position [m] and rotation vector [rad], shape (6,)."""
        keep = math.exp((self._noise_ns - now_ns) / NOISE_CORRELATION_NS)
        fresh = self._noise_sigma * self._random.standard_normal(6)
        self._noise = keep * self._noise + math.sqrt(1.0 - keep**2) * fresh
        self._noise_ns = now_ns
        return self._noise


def rig_wiring(config: Config) -> Wiring:
    """The rig's controller, mapped as configured; ConfigError if either mapping does not fit it."""
    rig, hand = config.rig, config.controller.hand
    try:
        moves = role_map(rig.controller_type, hand, rig.wiring.model_dump(exclude_none=True))
    except ConfigError as error:
        raise ConfigError(f"rig.wiring: {error}") from error
    plays = configured_role_map(rig.controller_type, hand, config.controller)
    return Wiring(rig.controller_type, hand, moves, plays)
