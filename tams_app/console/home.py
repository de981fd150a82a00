"""The `home` command: moves the arm to its ready pose while the operator holds Enter."""

from __future__ import annotations

import math
import threading
from contextlib import ExitStack
from functools import partial

from hw.arm import Arm
from hw.arms import arm_kind, reach_boundary
from tams_app.config import Config
from tams_app.errors import ConfigError, DeviceError, SetupError, SignalledError
from tams_app.faces.terminal.keys import TerminalKeys, handled_signals
from tams_app.printing import Console
from tams_app.robot.arm_gate import GATE_TIMEOUT_S
from tams_app.robot.build import check_ready_pose
from tams_app.robot.control import Signals
from tams_app.robot.guarding import Guarding
from tams_app.robot.home_run import POLL_S, HomeRun
from tams_app.robot.homing import HomingState
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.mailbox import BoundedQueue
from tams_app.runtime.parts import Ending
from tams_app.runtime.worker import Worker
from tams_app.station.seat import require_local_seat

_POLL_S = 0.02
_LAST_WORDS_S = 1.0
_CAPACITY = 64
_ENTER = b"\r\n"


def run_home(config: Config, terminal_fd: int = 0, console: Console | None = None) -> int:
    """Move the arm to its ready pose; 0 if it is there, 1 if the operator ended it before.

    Where a step fails, or a signal ends it, it raises a TamsError, with the arm stopped.
    """
    if config.rig.enabled:
        raise ConfigError("home moves a real arm: give --config with a file of your hardware")
    require_local_seat(config, True, "the terminal")
    check_ready_pose(config)
    clock, signals = MonotonicClock(), Signals()
    ending = Ending(clock)

    def stop_at_once() -> None:
        ending.request_end("stopped by SIGUSR1")
        signals.estop()

    def not_stopped(name: str, failure: BaseException) -> None:
        ending.request_end(f"{name}: {failure!r}")

    with handled_signals(ending.request_end, stop_at_once, not_stopped), ExitStack() as stack:
        keys = TerminalKeys(terminal_fd)
        stack.callback(keys.close)
        keys.open()
        if not keys.active:
            raise SetupError("home needs a terminal of its own: the arm moves while Enter is held")
        dialogue = Dialogue(keys, console or Console(), ending)
        stack.callback(dialogue.close)
        dialogue.start()
        boundary = reach_boundary(config.arm, config.limits)
        kind = arm_kind(config.arm.model)
        arm = kind.make_arm(config.arm, clock, config.control.rate_hz, boundary)
        guard = Guarding(
            config.arm,
            config.limits,
            None,
            signals,
            lambda _level, text: dialogue.notify(text),
            math.radians(config.arm.ready_speed_deg_s),
        )
        dialogue.notify(f"Connecting to the arm at {config.arm.host} ...")
        guard.join(arm, stack, partial(connect_with_consent, arm, dialogue))
        dialogue.go_on()
        run = HomeRun(config, clock, arm, guard, signals)

        def failed(name: str, failure: BaseException) -> None:
            dialogue.notify(f"{name}: {failure!r}")
            signals.fail()

        gate = Worker("arm-gate", run.gate.run, failed)
        stack.callback(gate.stop, GATE_TIMEOUT_S)
        gate.start()
        keys.discard()  # those pressed so far were for something else
        state = _carried_out(run, dialogue)
        if state is not HomingState.DONE:
            dialogue.go_on()
        return 0 if state is HomingState.DONE else 1


def _carried_out(run: HomeRun, dialogue: Dialogue) -> HomingState:
    """DONE or ENDED, the arm stopped; DeviceError, with the arm stopped, if it failed."""
    with run:
        for sentence in run.sentences():
            dialogue.notify(sentence)
        while not run.over:
            keys = dialogue.read_keys(POLL_S)
            for sentence in run.step(keys, dialogue.all_shown()):
                dialogue.notify(sentence)
    return run.result


class Dialogue:
    """Shows sentences without waiting and reads keys; for one thread, between `start` and `close`.

    Printing may block for any time (a terminal that is not read, a stalled remote shell):
    it is done in a thread of its own, so that reading the deadman key goes on.
    """

    def __init__(self, keys: TerminalKeys, console: Console, ending: Ending) -> None:
        """`ending`: once it is requested, no key is read any more."""
        self._keys, self._console, self._ending = keys, console, ending
        self._texts: BoundedQueue[str] = BoundedQueue(_CAPACITY)
        self._notified = 0
        self._printed = 0
        self._printer = Worker("printer", self._print, lambda _name, _failure: None)

    def start(self) -> None:
        self._printer.start()

    def close(self) -> None:
        """Print what is left, if the terminal takes it in time."""
        self._printer.request_stop()
        self._printer.join(_LAST_WORDS_S)

    def go_on(self) -> None:
        """SignalledError if a signal asked to end."""
        if reason := self._ending.requested_end:
            raise SignalledError(f"{reason} before the arm was in its ready pose")

    def notify(self, text: str) -> None:
        """Have `text` printed; does not wait."""
        self._notified += 1
        self._texts.put(text)

    def all_shown(self) -> bool:
        """True if every text is on the screen; never again if one was dropped."""
        return self._printed == self._notified

    def read_keys(self, timeout_s: float) -> bytes:
        """The keys pressed within `timeout_s`; DeviceError if the terminal is gone."""
        self.go_on()
        if self._printer.failure is not None:
            raise DeviceError("The terminal takes no text; start TAMS again from a new one.")
        return self._keys.read_bytes(timeout_s)

    def confirms(self, question: str) -> bool:
        """Ask once the question can be read; True if Enter, and nothing else, answers it."""
        self.notify(question)
        while not self.all_shown():
            if self.read_keys(_POLL_S).strip(_ENTER):
                return False
        self._keys.discard()  # which were for something else
        answer = b""
        while not answer:
            answer = self.read_keys(_POLL_S)
        return not answer.strip(_ENTER)

    def _print(self, stop: threading.Event) -> None:
        while (texts := self._texts.take_all(_POLL_S)) or not stop.is_set():
            for text in texts:
                self._console.print(text, soft_wrap=True)
                self._printed += 1


def connect_with_consent(arm: Arm, dialogue: Dialogue) -> None:
    """Connect; an error of the arm's controller is cleared if the operator confirms that."""
    try:
        arm.connect()
    except DeviceError:
        state = arm.state()
        if state is None or state.fault is None:
            raise
        if not dialogue.confirms(
            f"{state.fault.sentence}\nEnter clears the error, any other key ends."
        ):
            raise
        arm.clear_errors()
        arm.connect()
