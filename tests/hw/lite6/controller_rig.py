"""The controller model on TCP for tests of what is beyond the arm's contract."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from hw.sim.controller.model import ControllerModel, IdealPlant
from hw.sim.controller.server import ControllerServer
from tams_app.config import ArmConfig

WITHIN_S = 10.0  # generous: the machine may be busy


class ControllerRig:
    """A served controller model, and the configuration that reaches it."""

    def __init__(self, firmware: str = "2.6.0") -> None:
        joints = np.radians(ArmConfig().ready_joints_deg)
        self.model = ControllerModel(IdealPlant(), start_joints=joints, firmware=firmware)
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

    def config(self, reply_timeout_s: float = 0.5) -> ArmConfig:
        ports = self.server.ports
        return ArmConfig(
            control_port=ports.control,
            report_port=ports.report,
            reply_timeout_s=reply_timeout_s,
        )


@contextmanager
def controller(firmware: str = "2.6.0") -> Iterator[ControllerRig]:
    rig = ControllerRig(firmware)
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
