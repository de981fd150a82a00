"""The end of a session: on request, after its time, or because a part of it failed."""

from __future__ import annotations

import threading

from tams_app.runtime.clock import Clock
from tams_app.units import NS_PER_S


class Ending:
    """The end of any session; `ended` is set then, `failure` says if the job failed."""

    def __init__(self, clock: Clock, limit_s: float | None = None) -> None:
        """It ends by itself after `limit_s`."""
        self.ended = threading.Event()
        self.failure = ""  # why the job failed, in one sentence
        self._clock = clock
        self.limit_s = limit_s
        self._started_ns = clock.now_ns()
        self.end_reason = ""
        self.requested_end = ""

    def elapsed_s(self) -> float:
        """Seconds since the session began."""
        return (self._clock.now_ns() - self._started_ns) / NS_PER_S

    @property
    def time_is_up(self) -> bool:
        """True if it has lasted for as long as it may."""
        return self.limit_s is not None and self.elapsed_s() >= self.limit_s

    def end(self, reason: str) -> None:
        """Let the session end; the first reason counts. From any thread."""
        if not self.ended.is_set():
            self.end_reason = reason
            self.ended.set()

    def request_end(self, reason: str) -> None:
        """As `end`, for signal handlers: takes no lock, the next `poll` sees to it."""
        self.requested_end = reason

    def end_if_due(self) -> None:
        """End the session if that was requested or its time is up."""
        if self.requested_end:
            self.end(self.requested_end)
        if self.time_is_up:
            self.end(f"ended after {self.limit_s:g} s")
