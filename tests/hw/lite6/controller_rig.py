"""The controller model on TCP for tests of what is beyond the arm's contract."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from hw.lite6.protocol import Mode, State
from hw.sim.controller.model import ControllerModel, IdealPlant
from hw.sim.controller.server import ControllerServer
from tams_app.config import ArmConfig

WITHIN_S = 10.0  # generous: the machine may be busy


class ControllerRig:
    """A served controller model, and the configuration that reaches it."""

    def __init__(self, model: ControllerModel | None = None) -> None:
        """`model`: by default an ideal arm at the ready pose."""
        joints = np.radians(ArmConfig().ready_joints_deg)
        self.model = model or ControllerModel(IdealPlant(), start_joints=joints)
        self.server = ControllerServer(self.model)
        self.server.start()

    def restart(self) -> None:
        """The control box is switched off and on: same address, nothing of what was set."""
        ports = self.server.ports
        self.server.close()
        self.model = ControllerModel(IdealPlant(), start_joints=self.model.joints)
        self.server = ControllerServer(
            self.model, control_port=ports.control, report_port=ports.report
        )
        self.server.start()

    def make_ready(self, mode: Mode = Mode.POSITION) -> None:
        """As the arm of a session is: enabled, in this mode."""
        with self.server.lock:
            self.model.enable(True)
            self.model.set_mode(mode)
            self.model.set_state(0)

    @property
    def stopped(self) -> bool:
        with self.server.lock:
            return self.model.state == State.STOPPED

    def intercept(self, answer: Callable[[int, bytes], bytes | None]) -> None:
        """Have `answer` see each request first; where it gives None the model answers."""
        handle = self.model.handle

        def intercepted(register: int, payload: bytes, now_ns: int) -> bytes:
            given = answer(register, payload)
            return handle(register, payload, now_ns) if given is None else given

        self.model.handle = intercepted  # type: ignore[method-assign]

    def config(self, reply_timeout_s: float = 0.5) -> ArmConfig:
        ports = self.server.ports
        return ArmConfig(
            control_port=ports.control,
            report_port=ports.report,
            reply_timeout_s=reply_timeout_s,
        )


@contextmanager
def controller() -> Iterator[ControllerRig]:
    rig = ControllerRig()
    try:
        yield rig
    finally:
        rig.server.close()


def until(condition: Callable[[], bool], within_s: float = WITHIN_S) -> bool:
    """Poll until `condition` holds; False if it does not in good time."""
    deadline = time.monotonic() + within_s
    while time.monotonic() < deadline:
        if condition():
            return True
        time.sleep(0.005)
    return False
