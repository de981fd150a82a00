"""What a session prints, written by a thread of its own: no screen ever holds up the session."""

from __future__ import annotations

import contextlib
import io
import os
import select
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TextIO

from tams_app.runtime.mailbox import BoundedQueue
from tams_app.runtime.worker import Worker

CAPACITY = 256  # texts: a live line's of about a minute
PATIENCE_S = 2.0  # at the end, with a screen that takes nothing
_POLL_S = 0.05
_PIECE_BYTES = 4096  # what a pipe that is ready takes without waiting (PIPE_BUF)


class UnblockedOutput(io.TextIOBase):
    """Stands in for a text stream: `write` never waits, what finds the queue full is dropped."""

    def __init__(self, stream: TextIO) -> None:
        """Raises OSError if `stream` is no file of the system's."""
        self._stream, self._fd = stream, stream.fileno()
        self._queue: BoundedQueue[bytes] = BoundedQueue(CAPACITY)
        self._written = 0  # pieces
        self._given_up = threading.Event()
        self._worker = Worker("output", self._run, lambda _name, _failure: None)
        stream.flush()
        self._worker.start()

    @property
    def encoding(self) -> str:  # type: ignore[override]
        return self._stream.encoding

    def isatty(self) -> bool:
        return self._stream.isatty()

    def fileno(self) -> int:
        return self._fd

    def writable(self) -> bool:
        return True

    def write(self, text: str) -> int:
        self._queue.put(text.encode(self._stream.encoding, "replace"))
        return len(text)

    def flush(self) -> None:
        """Nothing to wait for."""

    def finish(self) -> OSError | None:
        """Write what is left, as long as the screen takes any; why it takes none, if it failed."""
        self._worker.request_stop()
        written = -1
        while written != self._written:
            written = self._written
            if self._worker.join(PATIENCE_S):
                break
        self._given_up.set()
        failure = self._worker.failure
        return failure if isinstance(failure, OSError) else None

    def _run(self, stop: threading.Event) -> None:
        ready = select.poll()
        ready.register(self._fd, select.POLLOUT)
        while (texts := self._queue.take_all(_POLL_S)) or not stop.is_set():
            rest = memoryview(b"".join(texts))
            while rest and not self._given_up.is_set():
                if ready.poll(_POLL_S * 1000):
                    with contextlib.suppress(BlockingIOError):  # another writer was faster
                        rest = rest[os.write(self._fd, rest[:_PIECE_BYTES]) :]
                        self._written += 1


@contextmanager
def unblocked_output() -> Iterator[None]:
    """Standard output and error never block what prints; OSError at the end if output fails."""
    before: dict[str, TextIO] = {"stdout": sys.stdout, "stderr": sys.stderr}
    outputs: dict[str, UnblockedOutput] = {}
    for name, stream in before.items():
        with contextlib.suppress(OSError):  # it is kept in memory, which never blocks
            outputs[name] = UnblockedOutput(stream)
            setattr(sys, name, outputs[name])
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before.values()
        failures = {name: output.finish() for name, output in outputs.items()}
    if (failure := failures.get("stdout")) is not None:
        raise failure
