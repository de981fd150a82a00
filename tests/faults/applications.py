"""Whole sessions on the simulated rig for faults: in this process, or in one of their own."""

from __future__ import annotations

import contextlib
import json
import os
import pty
import re
import select
import signal
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path

import numpy as np
import psutil
import pytest
import yaml

from hw.lite6.arm import Lite6
from hw.lite6.protocol import Register, State
from tams_app.config import CONFIG_DIRECTORY, Config, dump_config, load_config
from tams_app.recording import SessionLog, read_log
from tams_app.records import Vector
from tams_app.robot.control import ControlLoop
from tams_app.runtime.process import PROJECT_DIRECTORY
from tams_app.teleop.records import TeleopOutput
from tams_app.teleop.safety import ArmingState
from tests.spoken import spoken

PATIENCE_S = 60.0  # the machine may be busy with other things
MOVING_M_S = 0.02
REACH_M = 0.6  # of the hand: with 0.18 the operator lets go, to reach on, after 0.9 s
FPS = 10  # the frames are the rig's main load
_SOCKET_TIMEOUT_S = 5.0
_HEADER = struct.Struct(">HHH")
_CONTROL = re.compile(r"[\r\n]|\x1b\[[0-9;?]*[A-Za-z]")  # a terminal's, and ends of lines
_MODULES = {
    "rig": "hw.sim.rig",
    "renderer": "hw.sim.world.renderer",
    "relay": "tams_app.video.live.relay",
    "guard": "hw.guard.process",
    "quality": "tams_app.station.quality_process",
    "operator": "tams_app.station.operator_process",
    "link": "tams_app.link.gateway",
}


def until(condition: Callable[[], bool], what: str, within_s: float = PATIENCE_S) -> None:
    """Wait for a condition; AssertionError if it does not come in very good time."""
    deadline_s = time.monotonic() + within_s
    while not condition():
        assert time.monotonic() < deadline_s, f"waited for {what} in vain"
        time.sleep(0.02)


class Witness:
    """Another client with a connection to the arm's controller, who only ever asks."""

    def __init__(self, control_port: int) -> None:
        self._socket = socket.create_connection(("127.0.0.1", control_port), _SOCKET_TIMEOUT_S)
        self._socket.settimeout(_SOCKET_TIMEOUT_S)
        self._transaction = 0

    def state(self) -> int:
        """The controller's state now: 1 moving, 2 ready, 4 stopped."""
        return self._ask(Register.GET_STATE)[0]

    def position(self) -> Vector:
        """The TCP now [m]."""
        values: Vector = np.frombuffer(self._ask(Register.GET_TCP_POSE)[:12], "<f4") / 1000.0
        return values

    def moves(self) -> bool:
        """Whether the TCP moves."""
        return self._travel_m(0.1) > 0.001

    def waits_for_the_stop(self) -> None:
        """Until the controller is stopped with state 4."""
        until(lambda: self.state() == State.STOPPED, "state 4")

    def stands(self, seconds: float = 0.5) -> None:
        """The TCP does not move for so long."""
        until(lambda: self._travel_m(0.05) < 1e-6, "the arm to come to rest")
        assert self._travel_m(seconds) < 1e-5

    def close(self) -> None:
        self._socket.close()

    def _travel_m(self, seconds: float) -> float:
        before = self.position()
        time.sleep(seconds)
        return float(np.linalg.norm(self.position() - before))

    def _ask(self, register: Register) -> bytes:
        self._transaction += 1
        self._socket.sendall(_HEADER.pack(self._transaction, 2, 1) + bytes([register]))
        _, _, length = _HEADER.unpack(self._receive(_HEADER.size))
        return self._receive(length)[2:]  # after register and status

    def _receive(self, size: int) -> bytes:
        received = b""
        while len(received) < size:
            part = self._socket.recv(size - len(received))
            assert part, "the arm's controller has hung up"
            received += part
        return received


class Observed:
    """A session in this process: what its control loop did, and whether its arm stopped.

    `moving` is set as soon as the operator moves the arm. Whether it has stopped in the end is
    asked of its controller, just before the driver lets go of it.
    """

    def __init__(self, monkeypatch: pytest.MonkeyPatch) -> None:
        self.moving = threading.Event()
        self.outputs: list[TeleopOutput] = []  # since the arm moves
        self.arm_stopped = False
        tick, close = ControlLoop.tick, Lite6.close

        def observed_tick(loop: ControlLoop, due_ns: int, skipped: int = 0) -> TeleopOutput:
            output = tick(loop, due_ns, skipped)
            self._note(output)
            return output

        def observed_close(arm: Lite6) -> None:
            if self.moving.is_set() and not self.arm_stopped:
                witness = Witness(arm._config.control_port)
                witness.waits_for_the_stop()
                witness.stands(0.1)
                witness.close()
                self.arm_stopped = True
            close(arm)

        monkeypatch.setattr(ControlLoop, "tick", observed_tick)
        monkeypatch.setattr(Lite6, "close", observed_close)

    def _note(self, output: TeleopOutput) -> None:
        if self.moving.is_set():
            self.outputs.append(output)
            return
        twist = output.twist
        engaged = output.arming is ArmingState.ENGAGED
        if engaged and twist is not None and np.linalg.norm(twist.linear) > MOVING_M_S:
            self.moving.set()


def rig_config(out: Path) -> Config:
    """The simulated rig without windows and without real-time priority."""
    return load_config(
        overrides={
            "rig.enabled": True,
            "rig.operator.kind": "scripted",
            "headless": True,
            "seconds": PATIENCE_S,
            "control.realtime_priority": 0,
            "video.fps": FPS,
            "recording.directory": str(out),
            "recording.min_free_mb": 1.0,
        }
    )


def configuration_file(folder: Path, settings: Mapping[str, object]) -> Path:
    """The default configuration with these dotted keys, as a file in `folder`."""
    path = folder / "configuration.yaml"
    path.write_text(dump_config(load_config(None, dict(settings))), encoding="utf-8")
    return path


def only_log(out: Path) -> SessionLog:
    """The log of the only session in `out`."""
    (folder,) = out.iterdir()
    return read_log(folder / "session.mcap")


class Screen:
    """A terminal or a pipe that a process prints to, read until it is `stuck`."""

    def __init__(self, is_terminal: bool) -> None:
        self._ours, self.theirs = pty.openpty() if is_terminal else os.pipe()
        self._is_read = True

    def __iter__(self) -> Iterator[str]:
        while self._is_read:
            if select.select([self._ours], [], [], 0.05)[0]:
                text = os.read(self._ours, 65536).decode(errors="replace")
                yield from _CONTROL.sub("\n", text).split("\n")

    def stuck(self) -> None:
        """It takes no text any more."""
        self._is_read = False
        ours = os.open(f"/proc/self/fd/{self.theirs}", os.O_WRONLY | os.O_NONBLOCK | os.O_NOCTTY)
        for size in (4096, 1):
            with contextlib.suppress(BlockingIOError):
                while True:
                    os.write(ours, b"." * size)
        os.close(ours)

    def close(self) -> None:
        os.close(self._ours)
        os.close(self.theirs)


class Application:
    """`run_tams.py run` in a process of its own, on the rig, armed once; ends it when left."""

    def __init__(
        self,
        out: Path,
        quality: bool = False,
        operator: str = "scripted",
        words: Sequence[str] = ("run", "--arm"),
        screen: Screen | None = None,
        **overrides: object,
    ) -> None:
        """`quality`: the frames are compared as well. `operator`: who works. `words`: what runs.

        `screen`: where it prints, and reads keys if that is a terminal; None: pipes of its own.
        All limits are the product's own; `overrides` are sections of the configuration.
        """
        self.out = out / "logs"
        settings = {
            "version": 1,
            "include": [str(CONFIG_DIRECTORY / "tams.yaml")],
            "headless": True,
            "rig": {"operator": {"kind": operator, "arm_reach_m": REACH_M}},
            "recording": {"directory": str(self.out), "min_free_mb": 1.0},
            "video": {"fps": FPS, "quality": {"enabled": quality}},
            **overrides,
        }
        path = out / "application.yaml"
        path.write_text(yaml.safe_dump(settings), encoding="utf-8")
        self.lines: list[str] = []
        self._screen = screen
        self.process = subprocess.Popen(
            [sys.executable, "run_tams.py", *words, "--config", str(path)],
            cwd=PROJECT_DIRECTORY,
            stdin=subprocess.DEVNULL if screen is None else screen.theirs,
            stdout=subprocess.PIPE if screen is None else screen.theirs,
            stderr=subprocess.PIPE if screen is None else screen.theirs,
            text=True,
        )
        self._reader = threading.Thread(target=self._read, name="words", daemon=True)
        self._reader.start()
        self._children: list[psutil.Process] = []
        self._helpers: dict[str, psutil.Process] = {}
        self._kept: list[int] = []
        self.witness: Witness | None = None

    def __enter__(self) -> Application:
        return self

    def __exit__(self, *exception: object) -> None:
        self._note_children()
        if self.process.poll() is None:
            self.process.kill()
        self.process.wait(PATIENCE_S)
        if self.witness is not None:
            self.witness.close()
        self.let_go()
        for child in self._children:
            with contextlib.suppress(psutil.NoSuchProcess):
                child.resume()
        _, alive = psutil.wait_procs(self._children, timeout=PATIENCE_S)
        self._reader.join(PATIENCE_S)
        for stream in filter(None, (self.process.stdout, self.process.stderr)):
            stream.close()
        assert all(child.status() == psutil.STATUS_ZOMBIE for child in alive), alive

    def engaged(self, after: int = 0) -> Witness:
        """Wait until the operator moves the arm; returns a witness who looks at it.

        Nothing has stopped it since the first `after` lines.
        """
        assert self.moves(after), self.lines[after:]
        return self.watched()

    def moves(self, after: int = 0) -> bool:
        """Wait until the operator moves the arm; False if a fault since `after` lines kept it."""

        def stopped() -> bool:
            return any(line.startswith("fault") for line in self.lines[after:])

        self.says(("engaged", "fault"), after)
        self.note_helpers()
        until(lambda: stopped() or self.watched().moves(), "the arm to move")
        return not stopped()

    def watched(self) -> Witness:
        """A witness who looks at the arm."""
        if self.witness is None:
            self.witness = Witness(self._control_port())
        return self.witness

    def note_helpers(self) -> None:
        """Find the helper processes that there are now, for `helper`."""
        self._note_children()
        words = {child: child.cmdline() for child in self._children}
        for name, module in _MODULES.items():
            if found := [child for child in words if module in words[child]]:
                (self._helpers[name],) = found

    def says(self, beginning: str | tuple[str, ...], after: int = 0) -> None:
        """Wait for a line that begins so, or in one of these ways, after the first `after`."""

        def said() -> bool:
            return any(line.startswith(beginning) for line in self.lines[after:])

        until(lambda: said() or not self._reader.is_alive(), f"the words {beginning!r}")
        assert said(), f"{beginning!r} is not among {self.lines[after:]}"

    def says_within(self, seconds: float, beginning: str | tuple[str, ...], after: int = 0) -> bool:
        """Whether it says so within that time."""
        deadline_s = time.monotonic() + seconds
        while time.monotonic() < deadline_s:
            if any(line.startswith(beginning) for line in self.lines[after:]):
                return True
            time.sleep(0.02)
        return False

    def helper(self, name: str) -> psutil.Process:
        """The helper process of that name."""
        return self._helpers[name]

    def keep_the_rig(self) -> None:
        """The rig outlives the application until `let_go`: its input does not close."""
        self._kept.append(os.open(f"/proc/{self.helper('rig').pid}/fd/0", os.O_WRONLY))

    def let_go(self) -> None:
        while self._kept:
            os.close(self._kept.pop())

    def ends(self, within_s: float = PATIENCE_S) -> tuple[int, str]:
        """Exit code and words on stderr, once it has ended."""
        code = self.process.wait(within_s)
        assert self.process.stderr is not None
        return code, self.process.stderr.read()

    def interrupted(self) -> SessionLog:
        """End it in order, as by Ctrl-C; its log."""
        self.process.send_signal(signal.SIGINT)
        code, words = self.ends()
        assert (code, words.startswith("tams: ended by SIGINT")) == (130, True)
        log = only_log(self.out)
        assert not log.truncated
        return log

    def _read(self) -> None:
        for line in self._screen or self.process.stdout or ():
            self.lines.append(spoken(line))

    def _note_children(self) -> None:
        with contextlib.suppress(psutil.NoSuchProcess):
            found = psutil.Process(self.process.pid).children(recursive=True)
            self._children = found or self._children

    def _control_port(self) -> int:
        specification = json.loads(self.helper("guard").cmdline()[-1])
        return int(specification["control_port"])
