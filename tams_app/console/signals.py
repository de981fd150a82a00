"""The signals that end a command which moves an arm: handed on, so that the arm stops in order."""

from __future__ import annotations

import signal
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from types import FrameType

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)


@contextmanager
def handled_signals(end: Callable[[str], None], stop_arm: Callable[[], None]) -> Iterator[None]:
    """Ctrl-C, SIGTERM and a closed terminal call `end` with the reason, SIGUSR1 calls `stop_arm`.

    Both are called in the main thread, between any two of its instructions: they must not wait
    for a lock that it may hold. What was there before comes back at the end.
    """

    def handle(number: int, _frame: FrameType | None) -> None:
        if number == signal.SIGUSR1:
            stop_arm()
        else:
            end(f"ended by {signal.Signals(number).name}")

    before = {number: signal.signal(number, handle) for number in (*ENDING, signal.SIGUSR1)}
    try:
        yield
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
