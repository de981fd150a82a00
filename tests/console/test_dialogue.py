"""What is said and answered at the terminal, on a real pseudo-terminal."""

from __future__ import annotations

import io
import os
import pty
import threading
from collections.abc import Callable, Iterator

import pytest

from tams_app.console.home import Dialogue
from tams_app.errors import DeviceError
from tams_app.faces.terminal.keys import TerminalKeys
from tams_app.printing import Console
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.parts import Ending

pytestmark = pytest.mark.waiting


class Screen(io.StringIO):
    """Takes text only while it is `open`, and then calls `on_text`."""

    def __init__(self) -> None:
        super().__init__()
        self.open = threading.Event()
        self.open.set()
        self.on_text: Callable[[str], None] = lambda text: None

    def write(self, text: str) -> int:
        self.open.wait(60.0)
        written = super().write(text)
        self.on_text(text)
        return written


class Keys(TerminalKeys):
    """The operator types `answer` right after what was typed before is forgotten."""

    def __init__(self, operator: int, terminal: int) -> None:
        super().__init__(terminal)
        self._operator = operator
        self.answer = b""

    def discard(self) -> None:
        super().discard()
        os.write(self._operator, self.answer)


class Bench:
    def __init__(self) -> None:
        self.operator, self.terminal = pty.openpty()
        self.screen = Screen()
        self.keys = Keys(self.operator, self.terminal)
        self.keys.open()
        self.dialogue = Dialogue(
            self.keys, Console(file=self.screen, width=100), Ending(MonotonicClock())
        )
        self.dialogue.start()

    def close(self) -> None:
        self.screen.open.set()
        self.dialogue.close()
        self.keys.close()
        os.close(self.operator)
        os.close(self.terminal)


@pytest.fixture
def bench() -> Iterator[Bench]:
    made = Bench()
    yield made
    made.close()


@pytest.mark.parametrize(
    ("keys", "confirmed"),
    [
        (b"\r", True),
        (b"\n", True),
        (b"\r\r", True),
        (b"\rq", False),
        (b" ", False),
        (b"q\r", False),
    ],
)
def test_enter_and_nothing_else_confirms(bench: Bench, keys: bytes, confirmed: bool) -> None:
    bench.keys.answer = keys
    assert bench.dialogue.confirms("Really?") is confirmed


def test_what_was_pressed_before_the_question_does_not_answer_it(bench: Bench) -> None:
    os.write(bench.operator, b"\r\r\r")
    bench.keys.answer = b"n"
    assert not bench.dialogue.confirms("Really?")


def test_saying_does_not_wait_and_tells_when_it_is_shown(bench: Bench) -> None:
    bench.screen.open.clear()
    for _ in range(1000):
        bench.dialogue.notify("again")
    assert not bench.dialogue.all_shown()


def test_what_was_said_last_is_shown_before_the_end(bench: Bench) -> None:
    bench.dialogue.notify("one")
    bench.dialogue.notify("two")
    bench.dialogue.close()
    assert bench.screen.getvalue() == "one\ntwo\n"
    assert bench.dialogue.all_shown()


def test_while_the_question_cannot_be_read_another_key_ends_it(bench: Bench) -> None:
    bench.screen.open.clear()
    os.write(bench.operator, b"\r\x1b")
    assert not bench.dialogue.confirms("Really?")


def test_a_screen_that_fails_ends_the_reading(bench: Bench) -> None:
    def fail(text: str) -> None:
        raise OSError(text)

    bench.screen.on_text = fail
    bench.dialogue.notify("lost")

    def read_on() -> None:
        for _ in range(600):
            bench.dialogue.read_keys(0.1)

    with pytest.raises(DeviceError, match="terminal"):
        read_on()
