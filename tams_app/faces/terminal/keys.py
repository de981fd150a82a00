"""The terminal: Enter confirms, space or Esc stops the arm, q ends; and the signals that end it."""

from __future__ import annotations

import atexit
import contextlib
import os
import re
import select
import signal
import termios
import threading
import tty
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from types import FrameType

from tams_app.errors import DeviceError
from tams_app.faces.commands import LETTERS, Command
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.worker import Worker
from tams_app.units import NS_PER_MS

POLL_S = 0.2
REPEAT_NS = 700 * NS_PER_MS  # a held key repeats after up to 0.66 s (X11's default), then faster
_KEYS = {
    ord("\r"): Command.CONFIRM,
    ord("\n"): Command.CONFIRM,
    ord(" "): Command.EMERGENCY_STOP,
    0x1B: Command.EMERGENCY_STOP,  # Esc
    0x08: Command.NO_DROP,  # Backspace
    0x7F: Command.NO_DROP,  # Backspace of most terminals
    **{ord(one): command for key, command in LETTERS.items() for one in (key, key.upper())},
}
_SEQUENCES = {b"[5~": Command.DISCARD, b"[6~": Command.EPISODE}  # Page Up, Page Down: pedals
# a control sequence has parameters (0x20 to 0x3F), then one final byte (ECMA-48)
_TYPED = re.compile(rb"\x1b([\[O][\x20-\x3f]*.?)|.", re.DOTALL)


def decode_keys(data: bytes) -> list[Command]:
    """The keys in what was read at once; others mean nothing.

    Arrow and function keys send Esc and more in one go: `ESC [` and `ESC O` are no emergency stop.
    A sequence torn apart by a slow line reads as one: better a stop too many.
    """
    keys = (
        _SEQUENCES.get(typed[1]) if typed[1] else _KEYS.get(ord(typed[0]))
        for typed in _TYPED.finditer(data)
    )
    return [key for key in keys if key is not None]


class TerminalKeys:
    """Reads single keys from a terminal; where there is none, it does nothing.

    The terminal is put back as it was by `close`, and at the end of the process in any case.
    Ctrl-C keeps working, Ctrl-S is a key as any other: it stops no output.
    """

    def __init__(self, fd: int = 0) -> None:
        self._fd = fd
        self._before: list[int | list[bytes | int]] | None = None

    @property
    def active(self) -> bool:
        """True while keys are read."""
        return self._before is not None

    @property
    def readable(self) -> bool:
        """True if there is a terminal that `open` could read from."""
        return os.isatty(self._fd) and not _in_background(self._fd)

    def open(self) -> None:
        """Take keys one by one, without echo; what was typed before does not count."""
        if self.active or not self.readable:
            return
        self._before = termios.tcgetattr(self._fd)
        atexit.register(self.close)
        tty.setcbreak(self._fd, termios.TCSANOW)  # not after output that may be stuck
        modes = termios.tcgetattr(self._fd)
        modes[0] &= ~termios.IXON
        termios.tcsetattr(self._fd, termios.TCSANOW, modes)
        self.discard()

    def discard(self) -> None:
        """Forget what was typed and not read yet."""
        with contextlib.suppress(termios.error):  # the terminal is gone: the next reading shows it
            termios.tcflush(self._fd, termios.TCIFLUSH)

    def close(self) -> None:
        """Put the terminal back as it was; may be called twice."""
        before, self._before = self._before, None
        if before is None:
            return
        atexit.unregister(self.close)
        with contextlib.suppress(termios.error):  # the terminal is gone: nothing to put back
            termios.tcsetattr(self._fd, termios.TCSANOW, before)

    def read(self, timeout_s: float) -> list[Command]:
        """The keys pressed within `timeout_s`; DeviceError if the terminal is gone."""
        return decode_keys(self.read_bytes(timeout_s))

    def read_bytes(self, timeout_s: float) -> bytes:
        """The terminal's bytes within `timeout_s`, as they came; DeviceError if it is gone."""
        ready, _, _ = select.select([self._fd], [], [], timeout_s)
        if not ready:
            return b""
        try:
            data = os.read(self._fd, 1024)
        except OSError as error:
            raise DeviceError("The terminal is gone; start TAMS again from a new one.") from error
        if not data:
            raise DeviceError("The terminal was closed; start TAMS again from a new one.")
        return data

    def body(self, on_key: Callable[[Command, int], None]) -> Callable[[threading.Event], None]:
        """A worker's body that hands every key to `on_key` until stop is requested.

        With it comes when it was pressed at the earliest [ns]: when nothing had been typed yet.
        """
        clock = MonotonicClock()

        def run(stop: threading.Event) -> None:
            self.open()
            try:
                looked_ns = clock.now_ns()
                while self.active and not stop.is_set():
                    keys, before_ns = self.read(POLL_S), looked_ns
                    looked_ns = clock.now_ns()  # before keys are handed over, which may take long
                    for key in keys:
                        on_key(key, before_ns)
            finally:
                self.close()

        return run


class KeyPresses:
    """Distinguishes presses of one key from its auto-repeats: two confirmations are two presses."""

    def __init__(self) -> None:
        self._seen_ns: int | None = None

    def counts(self, now_ns: int) -> bool:
        """True if the key seen at `now_ns` was pressed anew; also one that does not is seen."""
        before_ns, self._seen_ns = self._seen_ns, now_ns
        return before_ns is None or now_ns - before_ns >= REPEAT_NS


def _in_background(fd: int) -> bool:
    """True if touching the terminal would suspend the whole session (SIGTTOU)."""
    try:
        return os.tcgetpgrp(fd) != os.getpgrp()
    except OSError:
        return False  # not our controlling terminal: no job control, nothing to fear


_RELAY_ENDS_S = 1.0
ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def handled_signals(
    end: Callable[[str], None],
    stop_arm: Callable[[], None],
    failed: Callable[[str, BaseException], None],
) -> Iterator[None]:
    """Ctrl-C, SIGTERM and a closed terminal call `end` with the reason, SIGUSR1 calls `stop_arm`.

    Both are called in a thread of their own, at once, whatever the main thread is busy with;
    `failed`, which may not raise itself, with the thread's name, if one of them raises. What was
    there before comes back at the end.
    """

    def handle(_number: int, _frame: FrameType | None) -> None:
        """Else the system would end the process; `relay` is woken up in any case."""

    def relay(_stop: threading.Event) -> None:
        with os.fdopen(woken, "rb", buffering=0) as pipe:
            while numbers := pipe.read(64):
                asked = [stop_arm] if signal.SIGUSR1 in numbers else []
                asked += [
                    partial(end, f"ended by {signal.Signals(number).name}")
                    for number in numbers
                    if number in ENDING
                ]
                for one in asked:  # one that raises keeps no other from being tried
                    try:
                        one()
                    except Exception as failure:  # noqa: BLE001 - the session fails by it
                        failed("signals", failure)

    woken, wake = os.pipe()
    os.set_blocking(wake, False)
    relaying = Worker("signals", relay)
    relaying.start()
    before = {number: signal.signal(number, handle) for number in (*ENDING, signal.SIGUSR1)}
    woken_before = signal.set_wakeup_fd(wake, warn_on_full_buffer=False)
    try:
        yield
    finally:
        signal.set_wakeup_fd(woken_before)
        for number, handler in before.items():
            signal.signal(number, handler)
        os.close(wake)
        relaying.join(_RELAY_ENDS_S)
