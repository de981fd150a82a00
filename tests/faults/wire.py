"""What reaches the arm's controller, request by request: the stop sequences are judged by this."""

from __future__ import annotations

import struct
import threading
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from hw.lite6.protocol import Register, State
from hw.sim.controller.core import ControllerSettings
from hw.sim.controller.model import ControllerModel, IdealPlant
from tams_app.config import ArmConfig
from tams_app.records import Vector

_MOTION = (Register.SET_CARTESIAN_VELOCITY, Register.MOVE_JOINT)
_QUERIES = (
    Register.GET_VERSION,
    Register.GET_STATE,
    Register.GET_ERROR,
    Register.TOOL_GPIO_READ,
)
_MM_PER_M = 1000.0


@dataclass(frozen=True, slots=True)
class Request:
    """One request as the controller got it, and the control tick it came in."""

    tick: int
    now_ns: int
    register: int
    payload: bytes
    connection: int = 0  # kernel id of the thread that serves it: one for each connection

    @property
    def is_stop(self) -> bool:
        return self.register == Register.SET_STATE and self.payload[0] == State.STOPPED

    @property
    def is_motion(self) -> bool:
        return self.register in _MOTION

    @property
    def is_query(self) -> bool:
        return self.register in _QUERIES

    @property
    def velocity(self) -> Vector:
        """Linear [m/s] and angular [rad/s] velocity of a velocity command, shape (6,)."""
        assert self.register == Register.SET_CARTESIAN_VELOCITY
        values = np.array(struct.unpack("<6f", self.payload[:24]), dtype=np.float64)
        values[:3] /= _MM_PER_M
        return values


class TappedModel(ControllerModel):
    """The controller model with a tap on its wire; `tick` is set by the bench that counts ticks.

    `interpose(register, payload)` may answer in the model's place (status byte and data), which
    then never hears of the request; None lets the model answer.
    """

    def __init__(self, *args: object, **kwargs: object) -> None:
        super().__init__(*args, **kwargs)  # type: ignore[arg-type]
        self.tick = 0
        self.wire: list[Request] = []
        self.interpose: Callable[[int, bytes], bytes | None] = lambda register, payload: None

    def handle(self, register: int, payload: bytes, now_ns: int) -> bytes:
        connection = threading.get_native_id()
        self.wire.append(Request(self.tick, now_ns, register, payload, connection))
        reply = self.interpose(register, payload)
        return super().handle(register, payload, now_ns) if reply is None else reply

    def power_cycle(self) -> None:
        """What the controller knew is gone; the arm stands with its brakes on."""
        self.settings = ControllerSettings()
        self.set_tcp_offset((0.0,) * 6)
        self.set_mode(0)
        self.enable(False)

    def since(self, tick: int) -> list[Request]:
        """Requests of control tick `tick` and later."""
        return [request for request in self.wire if request.tick >= tick]


def tapped_model() -> TappedModel:
    """The controller of an arm at the ready pose, as yet before the first tick."""
    joints = np.radians(np.array(ArmConfig().ready_joints_deg))
    model = TappedModel(IdealPlant(), start_joints=joints)
    model.tick = -1
    return model
