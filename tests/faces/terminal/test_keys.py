"""The keys of the terminal, on a real pseudo-terminal."""

from __future__ import annotations

import os
import pty
import queue
import select
import sys
import termios
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from tams_app.errors import DeviceError
from tams_app.faces.commands import Command
from tams_app.faces.terminal.keys import KeyPresses, TerminalKeys, decode_keys
from tams_app.runtime.worker import Worker
from tams_app.units import NS_PER_MS

pytestmark = pytest.mark.waiting

PROJECT = Path(__file__).resolve().parents[3]


@pytest.fixture
def terminal() -> Iterator[tuple[int, int]]:
    """(the operator's side, the program's side) of a pseudo-terminal."""
    operator, program = pty.openpty()
    yield operator, program
    for fd in (operator, program):
        os.close(fd)


@pytest.mark.parametrize(
    ("data", "keys"),
    [
        (b"\n", [Command.CONFIRM]),
        (b"\r", [Command.CONFIRM]),
        (b" ", [Command.EMERGENCY_STOP]),
        (b"\x1b", [Command.EMERGENCY_STOP]),
        (b"q", [Command.QUIT]),
        (b"Q", [Command.QUIT]),
        (b"a7\t", []),
        (b"xX\x7f\x08", [Command.DROP, Command.DROP, Command.NO_DROP, Command.NO_DROP]),
        (b"pP", [Command.PLACED, Command.PLACED]),
        (b"eEzZuU", [Command.EPISODE] * 2 + [Command.DISCARD] * 2 + [Command.REDO] * 2),
        (b"yYnN", [Command.SUCCESS] * 2 + [Command.FAILURE] * 2),
        (b"\x1b[6~\x1b[5~", [Command.EPISODE, Command.DISCARD]),  # Page Down, Page Up
        (b"\x1b[6;5~", []),  # Ctrl and Page Down
        (b"\x1b[A", []),  # arrow up
        (b"\x1b[1;5C", []),  # Ctrl and arrow right
        (b"\x1bOP", []),  # F1
        (b"\x1b[A ", [Command.EMERGENCY_STOP]),
        (b"\x1b\x1b", [Command.EMERGENCY_STOP, Command.EMERGENCY_STOP]),
        (b"\x1ba", [Command.EMERGENCY_STOP]),
        (b"q \n", [Command.QUIT, Command.EMERGENCY_STOP, Command.CONFIRM]),
    ],
)
def test_keys_mean_what_the_guide_says(data: bytes, keys: list[Command]) -> None:
    assert decode_keys(data) == keys


@pytest.fixture
def keys(terminal: tuple[int, int]) -> Iterator[TerminalKeys]:
    """Those of the terminal, read one by one."""
    keys = TerminalKeys(terminal[1])
    keys.open()
    yield keys
    keys.close()


def test_a_key_counts_at_once_without_enter(terminal: tuple[int, int], keys: TerminalKeys) -> None:
    os.write(terminal[0], b" ")
    assert keys.read(10.0) == [Command.EMERGENCY_STOP]
    assert keys.read(0.0) == []


def test_the_terminal_is_put_back_as_it_was(terminal: tuple[int, int]) -> None:
    _, program = terminal
    before = termios.tcgetattr(program)
    keys = TerminalKeys(program)
    keys.open()
    assert termios.tcgetattr(program)[3] & (termios.ICANON | termios.ECHO) == 0
    assert termios.tcgetattr(program)[3] & termios.ISIG  # Ctrl-C keeps working
    keys.close()
    keys.close()
    assert termios.tcgetattr(program) == before


def test_ctrl_s_is_a_key_and_stops_no_output(terminal: tuple[int, int], keys: TerminalKeys) -> None:
    operator, program = terminal
    os.write(operator, b"\x13")
    assert keys.read_bytes(20.0) == b"\x13"
    os.write(program, b"still here")
    assert select.select([operator], [], [], 20)[0]


def test_what_is_discarded_or_was_typed_before_does_not_count(terminal: tuple[int, int]) -> None:
    operator, program = terminal
    keys = TerminalKeys(program)
    for forget in (keys.open, keys.discard):
        os.write(operator, b"\r\r\r\n")
        assert select.select([program], [], [], 20)[0]  # it has arrived
        forget()
        assert keys.read_bytes(0.0) == b""
    keys.close()


def test_a_handler_that_fails_leaves_a_sane_terminal(terminal: tuple[int, int]) -> None:
    operator, program = terminal
    before = termios.tcgetattr(program)
    failures: list[BaseException] = []

    def broken(key: Command, _asked_ns: int) -> None:
        raise RuntimeError(key.value)

    keys = TerminalKeys(program)
    keys.open()
    worker = Worker("keys", keys.body(broken), lambda name, failure: failures.append(failure))
    os.write(operator, b"q")
    worker.start()
    deadline = time.monotonic() + 20
    while worker.alive and time.monotonic() < deadline:
        time.sleep(0.01)
    assert [str(failure) for failure in failures] == ["quit"]
    assert termios.tcgetattr(program) == before


def test_a_worker_hands_over_keys_until_it_is_stopped(
    terminal: tuple[int, int], keys: TerminalKeys
) -> None:
    seen: queue.Queue[Command] = queue.Queue()
    worker = Worker("keys", keys.body(lambda key, _asked_ns: seen.put(key)))
    worker.start()
    for typed, key in ((b"\x1b", Command.EMERGENCY_STOP), (b"q", Command.QUIT)):
        os.write(terminal[0], typed)
        assert seen.get(timeout=20) is key
    worker.stop(10)
    assert seen.empty()


def in_terminal(script: str) -> str:
    """What `script` says when it runs as the session leader of a pseudo-terminal of its own."""
    pid, operator = pty.fork()
    if pid == 0:
        os.chdir(PROJECT)
        os.execv(sys.executable, [sys.executable, "-c", script + "; print('the end', flush=True)"])
    notices = b""
    try:
        while b"the end" not in notices:
            notices += os.read(operator, 1024)
    finally:
        os.close(operator)
        os.waitpid(pid, 0)
    return notices.decode()


def test_a_process_that_ends_without_closing_puts_the_terminal_back() -> None:
    inner = (
        "import sys; from tams_app.faces.terminal.keys import TerminalKeys; k = TerminalKeys(0); "
        "k.open(); assert k.active; sys.exit('the main thread died')"
    )
    outer = (
        f"import subprocess, sys, termios; subprocess.run([sys.executable, '-c', {inner!r}]); "
        "modes = termios.tcgetattr(0)[3]; "
        "print('canonical' if modes & termios.ICANON else 'raw', flush=True)"
    )
    notices = in_terminal(outer)
    assert "the main thread died" in notices
    assert "canonical" in notices


def test_a_terminal_that_goes_away_is_told_and_ends_the_reading() -> None:
    operator, program = pty.openpty()
    keys = TerminalKeys(program)
    os.close(operator)
    try:
        with pytest.raises(DeviceError, match="terminal"):
            keys.read(10.0)
    finally:
        os.close(program)


def test_without_a_terminal_there_are_no_keys_and_no_waiting() -> None:
    reading, writing = os.pipe()
    try:
        keys = TerminalKeys(reading)
        keys.open()
        assert not keys.active
        keys.body(lambda key: None)(threading.Event())  # returns at once
        keys.close()
    finally:
        os.close(reading)
        os.close(writing)


def test_in_the_background_the_terminal_is_left_alone() -> None:
    inner = (
        "from tams_app.faces.terminal.keys import TerminalKeys; k = TerminalKeys(0); k.open(); "
        "print('keys are', 'read' if k.active else 'left', flush=True)"
    )
    run = f"subprocess.run([sys.executable, '-c', {inner!r}], process_group=0)"
    outer = f"import subprocess, sys; {run}"
    assert "keys are left" in in_terminal(outer)


# --- presses --------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("times_ms", "counted"),
    [
        *(([5000, *range(5000 + first, 60_000, 33)], [5000]) for first in (250, 500, 660)),  # held
        ([0, 700, 1500, 9000], [0, 700, 1500, 9000]),
        ([0, 500, 1000, 1700], [0, 1700]),  # what is too soon puts the next one off
        ([100, 100, 100], [100]),  # of one reading
    ],
)
def test_presses_apart_count_each_and_repeats_of_a_held_key_do_not(
    times_ms: list[int], counted: list[int]
) -> None:
    presses = KeyPresses()
    assert [at for at in times_ms if presses.counts(at * NS_PER_MS)] == counted
