"""`home` with the real driver, the real guard and a real terminal, against the controller model."""

from __future__ import annotations

import io
import json
import os
import pty
import signal
import subprocess
import sys
import termios
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest

from hw.lite6.kinematics import HOME_JOINTS
from hw.lite6.protocol import ErrorCode, Register, State
from hw.sim.controller.model import IdealPlant
from hw.sim.controller.server import ControllerServer
from tams_app.config import CONFIG_DIRECTORY, Config, load_config
from tams_app.console.home import run_home
from tams_app.errors import ConfigError, DeviceError, SetupError, TamsError
from tams_app.faces.terminal.keys import TerminalKeys
from tams_app.printing import Console
from tams_app.robot import guarding
from tams_app.runtime.process import PROJECT_DIRECTORY
from tams_app.units import NS_PER_S
from tests.console.test_dialogue import Screen
from tests.faults.wire import TappedModel
from tests.further import further

# Half of the shortest limit here, 400 ms without a beat.
pytestmark = [pytest.mark.timed, pytest.mark.second_chance(standstill_ms=200)]

WITHIN_S = 20.0  # generous: the machine may be busy
READY = np.radians([0, 36.81, 86.74, 0, 49.93, 0])


class Lab:
    """A controller at the factory's home, a terminal, and what is said on it."""

    def __init__(self) -> None:
        self.model = TappedModel(IdealPlant(), HOME_JOINTS)
        self.server = ControllerServer(self.model)
        self.server.start()
        self.master, self.terminal = pty.openpty()
        self.screen = io.StringIO()
        self.heartbeat_timeout_ms = 1000.0
        self.released = threading.Event()  # the Enter key
        self._ended = threading.Event()
        self._operators: list[threading.Thread] = []

    def config(self) -> Config:
        ports = self.server.ports
        config = load_config(
            None,
            {
                "arm.control_port": ports.control,
                "arm.report_port": ports.report,
                "arm.reply_timeout_s": 0.5,
                "arm.ready_speed_deg_s": 30.0,
                "controller.remote_seat": True,  # whoever runs the tests may sit elsewhere
            },
        )
        guard = {"heartbeat_timeout_ms": self.heartbeat_timeout_ms}
        arm = config.arm.model_copy(update={"guard": config.arm.guard.model_copy(update=guard)})
        rig = config.rig.model_copy(update={"enabled": False})
        # a machine that stands still for a moment is not what stops the arm here
        fresh = config.freshness.model_copy(update={"arm_state_ms": 2000.0})
        return config.model_copy(update={"arm": arm, "rig": rig, "freshness": fresh})

    def hold_enter(self) -> None:
        """An operator who holds Enter from now on."""

        def press() -> None:
            while not self._ended.wait(0.03) and not self.released.is_set():
                os.write(self.master, b"\r")

        self.operates(press)

    def press(self, key: bytes, after: str) -> None:
        """An operator who presses `key` now and again once these words are on the screen."""

        def press() -> None:
            while not self._ended.wait(0.3):
                if after in self.screen.getvalue():
                    os.write(self.master, key)

        self.operates(press)

    def until_stopped(self) -> None:
        while self.model.state != State.STOPPED:
            assert not self._ended.wait(0.02), "it never stopped"

    @property
    def moves(self) -> list[int]:
        """The registers of all moves that were asked for."""
        asked = [request.register for request in self.model.wire]
        return [register for register in asked if register == Register.MOVE_JOINT]

    def until_moving(self) -> None:
        deadline = time.monotonic() + WITHIN_S
        while not self.model.moving:
            assert time.monotonic() < deadline, "it never moved"
            time.sleep(0.02)

    def file(self, folder: Path) -> Path:
        """A configuration file for another process."""
        ports = self.server.ports
        arm = {"host": "127.0.0.1", "control_port": ports.control, "report_port": ports.report}
        arm |= {"reply_timeout_s": 0.5, "guard": {"heartbeat_timeout_ms": 1000.0}}
        path = folder / "lab.yaml"
        base = CONFIG_DIRECTORY / "lite6.yaml"
        path.write_text(f"version: 1\ninclude: [{base}]\narm: {json.dumps(arm)}\n")
        return path

    def run(self) -> int:
        return run_home(self.config(), self.terminal, Console(file=self.screen, width=200))

    def close(self) -> None:
        self._ended.set()
        for operator in self._operators:
            operator.join()
        self.server.close()
        os.close(self.master)
        os.close(self.terminal)

    def operates(self, press: Callable[[], None]) -> None:
        """In a thread of its own."""
        self._operators.append(threading.Thread(target=press))
        self._operators[-1].start()


@contextmanager
def _lab() -> Iterator[Lab]:
    made = Lab()
    with pytest.MonkeyPatch.context() as patch:
        # a machine that stands still for a moment is not what stops the arm here
        patch.setattr(guarding, "SILENCE_NS", 2 * NS_PER_S)
        try:
            yield made
        finally:
            made.close()


@pytest.fixture
def lab() -> Iterator[Lab]:
    with _lab() as made:
        yield made


@pytest.mark.parametrize("error", [ErrorCode.COLLISION, *further(ErrorCode.BOUNDARY)])
def test_holding_enter_brings_the_arm_home_even_out_of_an_error(lab: Lab, error: ErrorCode) -> None:
    with lab.server.lock:
        lab.model.raise_error(error)
    lab.hold_enter()
    assert lab.run() == 0
    np.testing.assert_allclose(lab.model.joints, READY, atol=2e-3)
    assert lab.model.state == State.STOPPED
    said = lab.screen.getvalue()
    assert f"C{error.value} (" in said
    assert "Enter clears the error" in said
    assert "ready pose" in said
    assert threading.active_count() < 12
    assert not {t.name for t in threading.enumerate()} & {"arm-sender", "arm-stop", "arm-report"}


def test_an_error_that_the_operator_does_not_clear_stays(lab: Lab) -> None:
    with lab.server.lock:
        lab.model.raise_error(ErrorCode.COLLISION)
    lab.press(b"n", after="Enter clears the error")
    with pytest.raises(DeviceError, match="C31"):
        lab.run()
    assert lab.model.error_code == ErrorCode.COLLISION


@pytest.mark.parametrize(
    "number", [signal.SIGINT, signal.SIGUSR1, *further(signal.SIGTERM, signal.SIGHUP)]
)
def test_a_signal_stops_the_moving_arm_and_gives_the_terminal_back(
    lab: Lab, number: signal.Signals
) -> None:
    def deadly(*_: object) -> None:
        raise AssertionError("this signal would have killed the process")

    def strike() -> None:
        lab.until_moving()
        os.kill(os.getpid(), number)

    as_before = termios.tcgetattr(lab.terminal)
    handler_before = signal.signal(number, deadly)
    try:
        lab.hold_enter()
        lab.operates(strike)
        with pytest.raises(TamsError, match=f"{number.name} before the arm was in its ready pose"):
            lab.run()
        assert signal.getsignal(number) is deadly
    finally:
        signal.signal(number, handler_before)
    assert termios.tcgetattr(lab.terminal) == as_before
    assert lab.model.state == State.STOPPED
    assert np.abs(lab.model.joints - READY).max() > 0.1


def test_a_signal_is_one_sentence_and_exit_code_130_for_the_shell(lab: Lab, tmp_path: Path) -> None:
    as_before = termios.tcgetattr(lab.terminal)
    process = subprocess.Popen(
        [sys.executable, "run_tams.py", "home", "--config", lab.file(tmp_path)],
        cwd=PROJECT_DIRECTORY,
        stdin=lab.terminal,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    lab.hold_enter()
    lab.until_moving()
    process.send_signal(signal.SIGTERM)
    _, said = process.communicate(timeout=30)
    assert process.returncode == 130
    assert said == "tams: ended by SIGTERM before the arm was in its ready pose\n"
    assert termios.tcgetattr(lab.terminal) == as_before
    assert lab.model.state == State.STOPPED


def test_an_arm_that_is_gone_on_its_way_is_told_with_the_stop_it_did_not_take(lab: Lab) -> None:
    def leave() -> None:
        lab.until_moving()
        lab.server.close()

    lab.hold_enter()
    lab.operates(leave)
    with pytest.raises(DeviceError) as failed:
        lab.run()
    before, _, after = str(failed.value).partition("; and ")
    assert any(word in before for word in ("lost", "reports", "reporting", "answer", "connection"))
    assert after.startswith("the arm did not acknowledge its last stop")


# --- the deadman key ------------------------------------------------------------------------------


class StuckScreen(io.StringIO):
    """Takes no text from the moment that one holds `word`, until it is let `go`."""

    def __init__(self, word: str) -> None:
        super().__init__()
        self._word = word
        self.stuck, self.go = threading.Event(), threading.Event()

    def write(self, text: str) -> int:
        if self._word in text:
            self.stuck.set()
        if self.stuck.is_set():
            self.go.wait(60.0)
        return super().write(text)


@pytest.mark.parametrize("word", ["Moving", *further("Releasing")])
def test_a_screen_that_blocks_does_not_keep_a_released_key_from_stopping(
    lab: Lab, word: str
) -> None:
    screen = lab.screen = StuckScreen(word)
    stood: list[bool] = []

    def operate() -> None:
        screen.stuck.wait(60.0)
        lab.until_moving()
        lab.released.set()
        lab.until_stopped()
        threading.Event().wait(0.5)  # it slows down
        before = lab.model.joints
        threading.Event().wait(0.3)
        stood.append(lab.model.joints == before and not screen.go.is_set())
        os.write(lab.master, b"\x13")  # Ctrl-S is a key as any other
        screen.go.set()

    lab.operates(operate)
    lab.hold_enter()
    assert lab.run() == 1
    assert stood == [True]


@pytest.mark.parametrize("since", ["Moving", *further("Releasing")])
def test_when_the_keys_are_not_read_any_more_the_guard_stops_the_arm(
    lab: Lab, monkeypatch: pytest.MonkeyPatch, since: str
) -> None:
    read = TerminalKeys.read_bytes
    stalled_at: list[np.ndarray] = []

    def stall(keys: TerminalKeys, timeout_s: float) -> bytes:
        if since in lab.screen.getvalue() and not stalled_at:
            stalled_at.append(np.array(lab.model.joints))
            threading.Event().wait(3.0)
            stalled_at.extend((np.array(lab.model.joints), np.array([lab.model.state])))
        return read(keys, timeout_s)

    monkeypatch.setattr(TerminalKeys, "read_bytes", stall)
    lab.heartbeat_timeout_ms = 400.0  # less and the machine's load stops the arm before
    lab.hold_enter()
    with pytest.raises(DeviceError, match="guard"):
        lab.run()
    before, after, state = stalled_at
    assert state == State.STOPPED
    assert np.degrees(np.abs(after - before).max()) < 40.0  # of 55: less than half of the stall


def test_sigusr1_stops_the_arm_at_once_also_while_the_keys_are_not_read(
    lab: Lab, monkeypatch: pytest.MonkeyPatch
) -> None:
    read = TerminalKeys.read_bytes
    stopped: list[bool] = []

    def stall(keys: TerminalKeys, timeout_s: float) -> bytes:
        if lab.model.moving and not stopped:
            os.kill(os.getpid(), signal.SIGUSR1)
            deadline_s = time.monotonic() + lab.heartbeat_timeout_ms / 2000
            while lab.model.state != State.STOPPED and time.monotonic() < deadline_s:
                time.sleep(0.01)
            stopped.append(lab.model.state == State.STOPPED)
        return read(keys, timeout_s)

    monkeypatch.setattr(TerminalKeys, "read_bytes", stall)
    lab.heartbeat_timeout_ms = 4000.0  # it is not the guard that stops the arm
    lab.hold_enter()
    with pytest.raises(TamsError, match="SIGUSR1 before the arm was in its ready pose"):
        lab.run()
    assert stopped == [True]


def test_enter_that_was_pressed_before_the_path_was_shown_moves_nothing(lab: Lab) -> None:
    screen, pressed = Screen(), list[int]()

    def press(text: str) -> None:
        if "Connecting" in text:
            pressed.append(os.write(lab.master, b"\r" * 40))

    lab.screen, screen.on_text = screen, press
    lab.press(b"q", after="ready pose")
    assert lab.run() == 1
    assert pressed
    assert lab.moves == []


def test_home_over_ssh_moves_nothing(lab: Lab, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("SSH_CONNECTION", "10.0.0.2 51000 10.0.0.1 22")
    config = lab.config()
    controller = config.controller.model_copy(update={"remote_seat": False})
    with pytest.raises(SetupError, match="the terminal is remote"):
        run_home(config.model_copy(update={"controller": controller}), lab.terminal)
    assert lab.model.wire == []


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
