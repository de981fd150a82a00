"""The tracked controller of the simulated rig: a scripted hand behind a sensor model.

No threads and no clock: `sample` moves the hand on to the given time. The same seed and the same
sequence of times, percepts and pulses give the same samples.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from enum import Enum
from typing import Protocol

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from hw.controller import Controller
from hw.openvr.components import (
    COMPONENTS,
    ROLES,
    ComponentReading,
    RoleMap,
    configured_role_map,
    role_map,
)
from hw.sim.operator.hand import Button, Hand
from tams_app.config import Config, OperatorConfig
from tams_app.errors import ConfigError
from tams_app.records import ControllerSample, ControllerStatus, Haptic, Pose
from tams_app.runtime.clock import NS_PER_MS

# Runtimes fuse cameras with inertial sensors: the error wanders rather than jumps at each sample.
NOISE_CORRELATION_NS = 200 * NS_PER_MS


class SensorFault(Enum):
    """What really happens to a tracked controller, and the status the runtime gives it."""

    TRACKING_LOST = ControllerStatus.TRACKING_LOST  # no pose; the buttons go on
    STANDBY = ControllerStatus.STANDBY  # laid aside: neither pose nor buttons
    DASHBOARD = ControllerStatus.DASHBOARD  # poses go on; the runtime keeps the buttons
    DISCONNECTED = ControllerStatus.DISCONNECTED  # flat battery, out of radio reach
    RUNTIME_QUIT = ControllerStatus.RUNTIME_QUIT
    ROLE_SWAPPED = ControllerStatus.ROLE_SWAPPED  # another controller has the hand's role
    TRACKING_FRAME_CHANGED = ControllerStatus.TRACKING_FRAME_CHANGED  # the headset was recentred
    FROZEN_POSE = "frozen pose"  # status OK, the same pose for ever
    FROZEN_BUTTONS = "frozen buttons"  # status OK, the buttons as they last were


_WITHOUT_POSE = frozenset(
    {
        SensorFault.TRACKING_LOST,
        SensorFault.STANDBY,
        SensorFault.DISCONNECTED,
        SensorFault.RUNTIME_QUIT,
        SensorFault.ROLE_SWAPPED,
        SensorFault.TRACKING_FRAME_CHANGED,
    }
)
_WITH_FRESH_BUTTONS = frozenset({None, SensorFault.TRACKING_LOST, SensorFault.FROZEN_POSE})
_OUT_OF_HAND = frozenset(  # pulses do not reach the operator
    {SensorFault.DISCONNECTED, SensorFault.RUNTIME_QUIT, SensorFault.ROLE_SWAPPED}
)
_NOTHING = ControllerSample(
    ControllerStatus.DISCONNECTED, None, 0, 0, trigger=0.0, grip=0.0, a=False, b=False, menu=False
)


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
        """What the mapping makes of a reading: role → 0..1."""
        return {role: reading.values[self._plays[role].path] for role in ROLES}


class VirtualController(Controller):
    """A controller held by `operator`, with tracking noise and faults to be injected."""

    def __init__(
        self, operator: Holder, config: OperatorConfig, seed: int, wiring: Wiring | None = None
    ) -> None:
        """`wiring`: None for a controller whose every button plays its own role."""
        self.operator = operator
        self._wiring = wiring
        self._random = np.random.default_rng([seed, 0x5E450])
        self._noise_sigma = np.repeat(
            (config.position_noise_mm / 1000.0, np.radians(config.rotation_noise_deg)), 3
        )
        self._noise: NDArray[np.float64] = np.zeros(6)
        self._noise_ns = 0
        self._fault: SensorFault | None = None
        self._started = False
        self._last = _NOTHING

    def start(self) -> None:
        self._started = True

    def sample(self, now_ns: int) -> ControllerSample:
        if not self._started:
            times = self._last.pose_ns, self._last.buttons_ns
            return replace(_NOTHING, pose_ns=times[0], buttons_ns=times[1])
        self.operator.step(now_ns)
        self._last = self._read(now_ns)
        return self._last

    def components(self) -> ComponentReading | None:
        """All that could be read of the newest sample's controller; None for one without wiring."""
        return self._wiring.reading(self._pressed()) if self._wiring is not None else None

    def pulse(self, haptic: Haptic) -> None:
        if self._started and self._fault not in _OUT_OF_HAND:
            self.operator.feel(haptic)

    def inject(self, fault: SensorFault | None) -> None:
        """From the next sample on suffer `fault`; None ends it."""
        self._fault = fault

    def close(self) -> None:
        self._started = False

    def _read(self, now_ns: int) -> ControllerSample:
        fault = self._fault
        status = ControllerStatus.OK
        if fault is not None and isinstance(fault.value, ControllerStatus):
            status = fault.value
        pose, pose_ns = self._read_pose(now_ns, fault)
        if fault not in _WITH_FRESH_BUTTONS:
            held = self._last if status is ControllerStatus.OK else _NOTHING
            return replace(
                held, status=status, pose=pose, pose_ns=pose_ns, buttons_ns=self._last.buttons_ns
            )
        pressed = self._pressed()
        if self._wiring is not None:
            pressed = self._wiring.roles(self._wiring.reading(pressed))
        return ControllerSample(
            status,
            pose,
            pose_ns,
            now_ns,
            trigger=pressed["trigger"],
            grip=pressed["grip"],
            a=pressed["a"] > 0.5,
            b=pressed["b"] > 0.5,
            menu=pressed["menu"] > 0.5,
        )

    def _pressed(self) -> dict[str, float]:
        """How far each part is pressed, 0..1."""
        hand = self.operator.hand
        buttons = {button.value: float(hand.button is button) for button in Button}
        return {"trigger": hand.trigger, "grip": hand.grip, **buttons}

    def _read_pose(self, now_ns: int, fault: SensorFault | None) -> tuple[Pose | None, int]:
        if fault in _WITHOUT_POSE:
            return None, self._last.pose_ns
        if fault is SensorFault.FROZEN_POSE and self._last.pose is not None:
            return self._last.pose, self._last.pose_ns
        measured = self.operator.hand.pose() + self._wander(now_ns)
        return Pose(measured[:3], Rotation.from_rotvec(measured[3:])), now_ns

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
