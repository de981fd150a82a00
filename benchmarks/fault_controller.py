"""The arm's controller as a process of its own, which keeps where its joints are, cycle by cycle.

Specification: trace (a folder), fault (see `_FAULTS`, happens on SIGUSR1), start_joints_deg.
Ready facts: control_port, report_port.
"""

from __future__ import annotations

import signal
from collections.abc import Callable
from enum import IntEnum
from pathlib import Path
from typing import Any

import numpy as np

from hw.lite6.protocol import ErrorCode, Register, State
from hw.sim.controller.model import ControllerModel, IdealPlant
from hw.sim.controller.server import ControllerServer
from tams_app.records import Vector
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.process import HelperSide
from tams_app.runtime.realtime import RIG_PRIORITY, use_fifo

CYCLES, EVENTS = "cycles.bin", "events.bin"
CYCLE = np.dtype([("t_ns", "<i8"), ("joints", "<f8", 6)])
EVENT = np.dtype([("t_ns", "<i8"), ("kind", "<i8")])
MAX_ROWS = 30_000  # two minutes at 250 Hz
NEVER_S = 60.0
_VELOCITY_BYTES = 24


class Kind(IntEnum):
    """What happened to the commanded motion."""

    MOVE = 1  # a velocity that is not zero, or a pose that is not the last one
    REST = 2
    STOP = 3  # state 4 was commanded
    HALT = 4  # the controller stopped by itself


class Trace:
    """Rows in a file that another process reads while it is written; unwritten rows have t_ns 0."""

    def __init__(self, path: Path, row: np.dtype[Any], mode: str = "w+") -> None:
        shape = (MAX_ROWS,)
        self.rows = np.memmap(path, dtype=row, mode=mode, shape=shape)  # type: ignore[call-overload]
        self._next = 0

    def append(self, *values: object) -> None:
        if self._next < MAX_ROWS:
            self.rows[self._next] = values
            self._next += 1


class TracedModel(ControllerModel):
    """The controller model that keeps its joints of every cycle and what was commanded."""

    def __init__(self, folder: Path, start_joints: Vector) -> None:
        super().__init__(IdealPlant(), start_joints)
        self.cycles = Trace(folder / CYCLES, CYCLE)
        self.events = Trace(folder / EVENTS, EVENT)

    def step(self, now_ns: int) -> None:
        super().step(now_ns)
        self.cycles.append(now_ns, self.joints)

    def handle(self, register: int, payload: bytes, now_ns: int) -> bytes:
        kind = self._kind(register, payload)
        if kind is not None:
            self.events.append(now_ns, kind)
        return super().handle(register, payload, now_ns)

    def _kind(self, register: int, payload: bytes) -> Kind | None:
        if register == Register.SET_STATE and payload[0] == State.STOPPED:
            return Kind.STOP
        if register == Register.SET_CARTESIAN_VELOCITY:
            return Kind.MOVE if any(payload[:_VELOCITY_BYTES]) else Kind.REST
        return None


def _error(model: TracedModel, server: ControllerServer) -> None:
    with server.lock:
        model.raise_error(ErrorCode.COLLISION)
        model.events.append(MonotonicClock().now_ns(), Kind.HALT)


def _freeze(model: TracedModel, _: ControllerServer) -> None:
    model.reports_frozen = True


def _fall_silent(_: TracedModel, server: ControllerServer) -> None:
    server.reply_delay_s = NEVER_S


_FAULTS: dict[str, Callable[[TracedModel, ControllerServer], None]] = {
    "arm error": _error,
    "reports frozen": _freeze,
    "no reply": _fall_silent,
}


def main() -> None:
    side = HelperSide()
    specification = side.specification
    start_joints = np.radians(np.array(specification["start_joints_deg"], float))
    model = TracedModel(Path(specification["trace"]), start_joints)
    server = ControllerServer(model, ended=side.stop_requested)
    fault = _FAULTS.get(specification["fault"])
    if fault is not None:
        signal.signal(signal.SIGUSR1, lambda *_: fault(model, server))
    use_fifo(RIG_PRIORITY)  # which the threads started afterwards inherit
    server.start()
    try:
        side.ready(control_port=server.ports.control, report_port=server.ports.report)
        side.stop_requested.wait()
    finally:
        server.close()


if __name__ == "__main__":
    main()
