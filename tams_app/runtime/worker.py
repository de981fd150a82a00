"""A named thread with an owner: its exception is kept, its stop is bounded."""

from __future__ import annotations

import threading
from collections.abc import Callable
from typing import TypeAlias

from tams_app.errors import TamsError

Body: TypeAlias = Callable[[threading.Event], None]  # of a thread, until the event is set
OnFailure: TypeAlias = Callable[[str, BaseException], None]  # of a thread or helper, by its name


class Worker:
    """Runs `body(stop)` in a thread until it returns or `stop` is set.

    An exception ends the thread, is kept in `failure`, and is handed to `on_failure` (called in
    the worker's thread) so that the owner learns of it at once.
    """

    def __init__(
        self,
        name: str,
        body: Body,
        on_failure: OnFailure | None = None,
    ) -> None:
        self.name = name
        self.failure: BaseException | None = None
        self._body = body
        self._on_failure = on_failure
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._run, name=name, daemon=True)

    def start(self) -> None:
        self._thread.start()

    def request_stop(self) -> None:
        """Ask the body to end, without waiting."""
        self._stop.set()

    def stop(self, timeout_s: float = 2.0) -> None:
        """Ask the body to end and wait; TamsError if it does not within `timeout_s`."""
        self._stop.set()
        if not self._thread.is_alive() or self._thread is threading.current_thread():
            return
        self._thread.join(timeout_s)
        if self._thread.is_alive():
            raise TamsError(f"thread {self.name} did not stop within {timeout_s:g} s")

    def join(self, timeout_s: float) -> bool:
        """Wait for the body to end; whether it has."""
        if self._thread.is_alive() and self._thread is not threading.current_thread():
            self._thread.join(timeout_s)
        return not self._thread.is_alive()

    @property
    def alive(self) -> bool:
        return self._thread.is_alive()

    def _run(self) -> None:
        try:
            self._body(self._stop)
        except BaseException as failure:
            self.failure = failure
            if self._on_failure is None:
                raise
            self._on_failure(self.name, failure)
