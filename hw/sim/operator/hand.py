"""A human hand with a controller in it: smooth, a little shaky, and of limited reach.

Everything is in the tracking frame (OpenVR: y up, right-handed).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray

from tams_app.records import Vector
from tams_app.vectors import ZERO, Floats3, floats, shortened

REST_POSITION_M = (0.15, 1.05, -0.35)  # in front of a seated person
WRIST_REACH_RAD = 0.8  # comfortable turn of the wrist to either side
PRESS_TRAVEL_S = 0.06  # trigger and grip, from free to fully pressed

# A commanded velocity is reached through two lags, which round off every start and stop: the
# bell-shaped speed of human reaching (Flash and Hogan 1985) without a planned end time.
_VELOCITY_LAG_S = 0.10
_ACCELERATION_LAG_S = 0.025
_MAX_SPEED_M_S = 0.6
_MAX_SPEED_RAD_S = 3.0
_MAX_ACCELERATION_M_S2 = 6.0
_MAX_ACCELERATION_RAD_S2 = 25.0
_STRETCH_GAIN_PER_S = 8.0  # outward speed allowed per metre left to the end of the reach
_STRETCH_MARGIN = 0.05  # of the reach, never used

# Physiological tremor lies between 8 and 12 Hz, about a tenth of a millimetre at rest.
_TREMOR_HZ = (8.0, 12.0)
_TREMOR_TONES = 3
_TREMOR_M = 4e-5
_TREMOR_RAD = 1e-4
_MAX_STEP_S = 0.01
_NOISE_CORRELATION_S = 0.15


class ThumbButton(Enum):
    """A button under the thumb, which presses one at a time."""

    A = "a"
    B = "b"
    MENU = "menu"


@dataclass(frozen=True, slots=True)
class HandCommand:
    """The hand's next motion: velocities [m/s], [rad/s], shape (3,), and presses."""

    linear: Vector
    angular: Vector
    trigger: bool = False
    grip: bool = False
    button: ThumbButton | None = None

    @staticmethod
    def still(
        trigger: bool = False, grip: bool = False, button: ThumbButton | None = None
    ) -> HandCommand:
        return HandCommand(np.zeros(3), np.zeros(3), trigger, grip, button)


class VelocityFollower:
    """Three coordinates that follow a commanded velocity smoothly and never pass `reach`.

    Computed in plain floats: numpy takes longer to be called than to add three numbers.
    """

    def __init__(self, reach: float, max_speed: float, max_acceleration: float) -> None:
        self.reach = reach
        self.offset: Vector = np.zeros(3)  # from the rest point
        self.velocity: Vector = np.zeros(3)
        self._offset, self._velocity, self._acceleration = ZERO, ZERO, ZERO
        self._max_speed = max_speed
        self._max_acceleration = max_acceleration

    def step(self, command: Vector, dt_s: float) -> None:
        """Move on by `dt_s` <= 10 ms towards the velocity `command`."""
        wanted = self._within_reach(shortened(floats(command), self._max_speed))
        (wx, wy, wz), (vx, vy, vz) = wanted, self._velocity
        lag = _VELOCITY_LAG_S
        needed = (wx - vx) / lag, (wy - vy) / lag, (wz - vz) / lag
        (tx, ty, tz), (ax, ay, az) = shortened(needed, self._max_acceleration), self._acceleration
        blend = 1.0 - math.exp(-dt_s / _ACCELERATION_LAG_S)
        ax, ay, az = ax + blend * (tx - ax), ay + blend * (ty - ay), az + blend * (tz - az)
        vx, vy, vz = vx + ax * dt_s, vy + ay * dt_s, vz + az * dt_s
        x, y, z = self._offset
        self._acceleration, self._velocity = (ax, ay, az), (vx, vy, vz)
        self._offset = x + vx * dt_s, y + vy * dt_s, z + vz * dt_s
        self._stop_at_reach()
        self.offset, self.velocity = np.array(self._offset), np.array(self._velocity)

    def _within_reach(self, command: Floats3) -> Floats3:
        """`command` without the outward speed that could not be stopped before the end."""
        (x, y, z), (vx, vy, vz), lag = self._offset, self._velocity, _VELOCITY_LAG_S
        x, y, z = x + lag * vx, y + lag * vy, z + lag * vz
        distance = math.sqrt(x * x + y * y + z * z)
        if distance < 1e-9:
            return command
        x, y, z = x / distance, y / distance, z / distance
        room = self.reach * (1.0 - _STRETCH_MARGIN) - distance
        cx, cy, cz = command
        excess = cx * x + cy * y + cz * z - max(0.0, _STRETCH_GAIN_PER_S * room)
        if excess <= 0.0:
            return command
        return cx - excess * x, cy - excess * y, cz - excess * z

    def _stop_at_reach(self) -> None:
        """A stretched arm goes no further, however it came to be there."""
        x, y, z = self._offset
        distance = math.sqrt(x * x + y * y + z * z)
        if distance > self.reach:
            x, y, z = x / distance, y / distance, z / distance
            self._offset = self.reach * x, self.reach * y, self.reach * z
            vx, vy, vz = self._velocity
            outward = max(0.0, vx * x + vy * y + vz * z)
            self._velocity = vx - outward * x, vy - outward * y, vz - outward * z


class MotorNoise:
    """The muscles' noise, in proportion to the movement (Harris and Wolpert 1998)."""

    def __init__(self, random: np.random.Generator, size: float) -> None:
        self._random = random
        self._size = size
        self._wander: NDArray[np.float64] = np.zeros(6)

    def disturb(self, linear: Vector, angular: Vector, dt_s: float) -> tuple[Vector, Vector]:
        """The velocities as they come out."""
        if self._size <= 0.0:
            return linear, angular
        keep = math.exp(-dt_s / _NOISE_CORRELATION_S)
        fresh = self._random.standard_normal(6)
        self._wander = keep * self._wander + math.sqrt(1.0 - keep**2) * fresh
        noise = self._size * self._wander
        speed, rate = math.sqrt(linear @ linear), math.sqrt(angular @ angular)
        return linear + speed * noise[:3], angular + rate * noise[3:]


class Hand:
    """Arm, wrist and fingers of one person; the attributes are where `step` leaves them."""

    def __init__(
        self,
        random: np.random.Generator,
        reach_m: float,
        tremor: float = 1.0,
        motor_noise: float = 0.0,
    ) -> None:
        """`tremor`: times that of a hand at rest; `motor_noise`: of the commanded speed, sigma."""
        self._noise = MotorNoise(random, motor_noise)
        self.arm = VelocityFollower(reach_m, _MAX_SPEED_M_S, _MAX_ACCELERATION_M_S2)
        # A rotation vector.
        self.wrist = VelocityFollower(WRIST_REACH_RAD, _MAX_SPEED_RAD_S, _MAX_ACCELERATION_RAD_S2)
        self.trigger = 0.0
        self.grip = 0.0
        self.button: ThumbButton | None = None
        self._rest = np.array(REST_POSITION_M)
        self._time_s = 0.0
        shape = (_TREMOR_TONES, 6)
        self._tremor_rad_s = 2.0 * math.pi * random.uniform(*_TREMOR_HZ, shape)
        self._tremor_phase = random.uniform(0.0, 2.0 * math.pi, shape)
        self._tremor_size = tremor * np.repeat((_TREMOR_M, _TREMOR_RAD), 3)

    def step(self, command: HandCommand, dt_s: float) -> None:
        """Move on by `dt_s` [s]; long steps are divided, the result hardly depends on it."""
        self._time_s += dt_s
        parts = max(1, math.ceil(dt_s / _MAX_STEP_S))
        linear, angular = self._noise.disturb(command.linear, command.angular, dt_s)
        for _ in range(parts):
            self.arm.step(linear, dt_s / parts)
            self.wrist.step(angular, dt_s / parts)
        self.trigger = _press(self.trigger, command.trigger, dt_s)
        self.grip = _press(self.grip, command.grip, dt_s)
        self.button = command.button

    def pose(self) -> NDArray[np.float64]:
        """Position [m] and rotation vector [rad] with tremor, shape (6,).

        The wrist's rates are integrated as a rotation vector: exact about one axis, and within the
        reach of a wrist close enough for an operator who watches what happens.
        """
        phases = self._tremor_rad_s * self._time_s + self._tremor_phase
        tremor = self._tremor_size * np.sin(phases).sum(axis=0)
        steady = np.concatenate((self._rest + self.arm.offset, self.wrist.offset))
        return np.asarray(steady + tremor)


def _press(value: float, pressed: bool, dt_s: float) -> float:
    change = dt_s / PRESS_TRAVEL_S
    return min(1.0, value + change) if pressed else max(0.0, value - change)
