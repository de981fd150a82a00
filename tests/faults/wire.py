"""What reaches the arm's controller, request by request: the stop sequences are judged by this."""

from __future__ import annotations

import struct
from dataclasses import dataclass

import numpy as np

from hw.sim.controller_codes import Register, State
from hw.sim.controller_model import ControllerModel
from tams_app.records import Vector

_MOTION = (
    Register.SET_CARTESIAN_VELOCITY,
    Register.MOVE_SERVO_CARTESIAN_AA,
    Register.MOVE_SERVO_CARTESIAN,
    Register.MOVE_JOINT,
)
_MM_PER_M = 1000.0


@dataclass(frozen=True, slots=True)
class Request:
    """One request as the controller got it, and the control tick it came in."""

    tick: int
    now_ns: int
    register: int
    payload: bytes

    @property
    def is_stop(self) -> bool:
        return self.register == Register.SET_STATE and self.payload[0] == State.STOPPED

    @property
    def is_motion(self) -> bool:
        return self.register in _MOTION

    @property
    def velocity(self) -> Vector:
        """Linear [m/s] and angular [rad/s] velocity of a velocity command, shape (6,)."""
        assert self.register == Register.SET_CARTESIAN_VELOCITY
        values = np.array(struct.unpack("<6f", self.payload[:24]), dtype=np.float64)
        values[:3] /= _MM_PER_M
        return values


class TappedModel(ControllerModel):
    """The controller model with a tap on its wire; `tick` is set by whoever counts ticks."""

    def __init__(self, *args: object, **kwargs: object) -> None:
        super().__init__(*args, **kwargs)  # type: ignore[arg-type]
        self.tick = 0
        self.wire: list[Request] = []

    def handle(self, register: int, payload: bytes, now_ns: int) -> bytes:
        self.wire.append(Request(self.tick, now_ns, register, payload))
        return super().handle(register, payload, now_ns)

    def since(self, tick: int) -> list[Request]:
        """Requests of control tick `tick` and later."""
        return [request for request in self.wire if request.tick >= tick]
