"""A question and answer at the terminal that the arm's deadman key is read from.

Printing may block for as long as it pleases (a terminal that is not read, a stalled remote shell):
it is done in a thread of its own, so that reading the key goes on.
"""

from __future__ import annotations

import threading
from collections.abc import Callable

from rich.console import Console

from tams_app.console.terminal import TerminalKeys
from tams_app.errors import DeviceError
from tams_app.runtime.mailbox import BoundedQueue
from tams_app.runtime.worker import Worker

_POLL_S = 0.02
_LAST_WORDS_S = 1.0
_CAPACITY = 64
_ENTER = b"\r\n"


class Dialogue:
    """Says things without waiting and reads keys; for one thread, between `start` and `close`."""

    def __init__(
        self, keys: TerminalKeys, console: Console, check: Callable[[], None] = lambda: None
    ) -> None:
        """`check` is called before each reading and may raise to end it."""
        self._keys, self._console, self._check = keys, console, check
        self._texts: BoundedQueue[str] = BoundedQueue(_CAPACITY)
        self._said = 0
        self._printed = 0
        self._printer = Worker("printer", self._print, lambda _name, _failure: None)

    def start(self) -> None:
        self._printer.start()

    def close(self) -> None:
        """Print what is left, if the terminal takes it in time."""
        self._printer.request_stop()
        self._printer.join(_LAST_WORDS_S)

    def say(self, text: str) -> None:
        """Have `text` printed; does not wait."""
        self._said += 1
        self._texts.put(text)

    def all_shown(self) -> bool:
        """Whether everything that was said is on the screen; never again if a text was dropped."""
        return self._printed == self._said

    def read_keys(self, timeout_s: float) -> bytes:
        """What was pressed within `timeout_s`; DeviceError if the terminal is gone."""
        self._check()
        if self._printer.failure is not None:
            raise DeviceError("The terminal takes no text; start TAMS again from a new one.")
        return self._keys.read_bytes(timeout_s)

    def discard_keys(self) -> None:
        """What was pressed so far was for something else."""
        self._keys.discard()

    def confirms(self, question: str) -> bool:
        """Whether Enter, and nothing else, answers the question once it can be read."""
        self.say(question)
        while not self.all_shown():
            if self.read_keys(_POLL_S).strip(_ENTER):
                return False
        self.discard_keys()
        answer = b""
        while not answer:
            answer = self.read_keys(_POLL_S)
        return not answer.strip(_ENTER)

    def _print(self, stop: threading.Event) -> None:
        while texts := self._wait_for_texts(stop):
            for text in texts:
                self._console.print(text, highlight=False, markup=False, soft_wrap=True)
                self._printed += 1

    def _wait_for_texts(self, stop: threading.Event) -> list[str]:
        """The next texts; none when it is to stop and nothing is left."""
        while not stop.is_set():
            if texts := self._texts.take_all(_POLL_S):
                return texts
        return self._texts.take_all()
