"""The threads and helper processes of one session, and its end, which may come at any time."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path

from tams_app.errors import TamsError
from tams_app.runtime.clock import Clock
from tams_app.runtime.process import HelperProcess
from tams_app.runtime.realtime import use_fifo
from tams_app.runtime.worker import Body, Worker
from tams_app.units import NS_PER_S


class Parts:
    """The parts that a session has started; one that fails or ends unasked is a failure.

    `stack` ends them in the reverse order of their start. `logs`: where helpers write.
    """

    def __init__(self, logs: Path, fail: Callable[[str], None], priority: int) -> None:
        """`fail` gets a failure in one sentence, from any thread.

        `priority`: of the control loop under SCHED_FIFO; 0: nothing runs in real time.
        """
        self.stack = ExitStack()
        self.logs = logs
        self._fail = fail
        self._priority = priority
        self._helpers: dict[str, HelperProcess] = {}
        self._measured: dict[str, int] = {}

    def run(self, name: str, body: Body, timeout_s: float = 2.0) -> Worker:
        """Start a thread, which is stopped with the session."""
        worker = Worker(name, body, self.on_failure)
        self.start(worker, timeout_s)
        return worker

    def start(self, worker: Worker, timeout_s: float = 2.0) -> None:
        """The same of a thread that is made already."""
        self.stack.callback(worker.stop, timeout_s)
        worker.start()

    def watch(self, name: str, process: HelperProcess) -> None:
        """The end of this process is the end of the session, from now on."""
        self._helpers[name] = process

    def measure(self, name: str, pid: int) -> None:
        """Record the load of this process, too; its end shows elsewhere, or is no failure."""
        self._measured[name] = pid

    def hurry(self, thread_ids: Mapping[str, int]) -> None:
        """Real-time priority, just below the control loop's, for what it waits for."""
        if self._priority:
            for thread_id in thread_ids.values():
                use_fifo(self._priority - 1, thread_id)

    def use_control_priority(self) -> str:
        """Real-time priority for the calling thread; what it has got (`use_fifo`)."""
        return use_fifo(self._priority)

    def on_failure(self, name: str, failure: BaseException) -> None:
        """A thread or a helper's connection has failed."""
        self._fail(str(failure) if isinstance(failure, TamsError) else f"{name}: {failure!r}")

    @property
    def pids(self) -> dict[str, int]:
        """Of the processes that are watched, once they are started, or measured."""
        pids = {name: process.pid for name, process in self._helpers.items()}
        return {name: pid for name, pid in pids.items() if pid is not None} | self._measured

    def poll(self) -> None:
        """See whether a process has ended, and send what one had no room for."""
        for name, process in self._helpers.items():
            process.resend()
            if process.exit_code is not None:
                self._fail(f"the helper process {name} ended unasked; see {self.logs}")


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
