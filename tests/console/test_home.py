"""`home` with the real driver, the real guard and a real terminal, against the controller model."""

from __future__ import annotations

import io
import os
import pty
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from rich.console import Console

from hw.lite6_kinematics import HOME_JOINTS
from hw.sim.controller_codes import ErrorCode, Register, State
from hw.sim.controller_server import ControllerServer
from hw.sim.plant import IdealPlant
from tams_app.config import Config, load_config
from tams_app.console.home import run_home
from tams_app.errors import ConfigError, SetupError
from tests.faults.wire import TappedModel

READY = np.radians([0, 36.81, 86.74, 0, 49.93, 0])


class Lab:
    """A controller at the factory's home, a terminal, and what is said on it."""

    def __init__(self) -> None:
        self.model = TappedModel(IdealPlant(), HOME_JOINTS)
        self.server = ControllerServer(self.model)
        self.server.start()
        self.master, self.terminal = pty.openpty()
        self.screen = io.StringIO()
        self._ended = threading.Event()
        self._operator: threading.Thread | None = None

    def config(self) -> Config:
        config = load_config(None)
        ports = self.server.ports
        arm = config.arm.model_copy(
            update={
                "control_port": ports.control,
                "report_port": ports.report,
                "reply_timeout_s": 0.5,
                "ready_speed_deg_s": 30.0,
                "guard": config.arm.guard.model_copy(update={"heartbeat_timeout_ms": 1000.0}),
            }
        )
        rig = config.rig.model_copy(update={"enabled": False})
        return config.model_copy(update={"arm": arm, "rig": rig})

    def hold_enter(self) -> None:
        """An operator who holds Enter from now on."""

        def press() -> None:
            while not self._ended.wait(0.03):
                os.write(self.master, b"\r")

        self._operator = threading.Thread(target=press)
        self._operator.start()

    def run(self) -> int:
        return run_home(self.config(), self.terminal, Console(file=self.screen, width=200))

    def close(self) -> None:
        self._ended.set()
        if self._operator is not None:
            self._operator.join()
        self.server.close()
        os.close(self.master)
        os.close(self.terminal)


@contextmanager
def _lab() -> Iterator[Lab]:
    made = Lab()
    try:
        yield made
    finally:
        made.close()


@pytest.fixture
def lab() -> Iterator[Lab]:
    with _lab() as made:
        yield made


def test_holding_enter_brings_the_arm_home_even_out_of_an_error(lab: Lab) -> None:
    with lab.server.lock:
        lab.model.raise_error(ErrorCode.BOUNDARY)
    lab.hold_enter()
    assert lab.run() == 0
    np.testing.assert_allclose(lab.model.joints, READY, atol=2e-3)
    assert lab.model.state == State.STOPPED
    said = lab.screen.getvalue()
    assert "C35" in said
    assert "ready pose" in said
    assert threading.active_count() < 12
    assert not {t.name for t in threading.enumerate()} & {"arm-sender", "arm-stop", "arm-report"}


def test_another_key_ends_it_without_moving(lab: Lab) -> None:
    threading.Timer(1.5, os.write, (lab.master, b" ")).start()
    assert lab.run() == 1
    moves = [request for request in lab.model.wire if request.register == Register.MOVE_JOINT]
    assert moves == []


def test_home_is_for_hardware_and_for_a_terminal(lab: Lab) -> None:
    with pytest.raises(ConfigError, match="real arm"):
        run_home(load_config(None))
    read, write = os.pipe()
    try:
        with pytest.raises(SetupError, match="terminal"):
            run_home(lab.config(), read)
    finally:
        os.close(read)
        os.close(write)
