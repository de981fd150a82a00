"""Worker threads and helper processes of one session: started in order, ended in reverse."""

from __future__ import annotations

import threading
from collections.abc import Callable, Mapping
from contextlib import ExitStack
from pathlib import Path

from tams_app.errors import TamsError
from tams_app.runtime.process import HelperProcess
from tams_app.runtime.realtime import use_fifo
from tams_app.runtime.worker import Worker


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

    def run(
        self, name: str, body: Callable[[threading.Event], None], timeout_s: float = 2.0
    ) -> Worker:
        """Start a thread, which is stopped with the session."""
        worker = Worker(name, body, self.on_failure)
        self.stack.callback(worker.stop, timeout_s)
        worker.start()
        return worker

    def watch(self, name: str, process: HelperProcess) -> None:
        """The end of this process is the end of the session, from now on."""
        self._helpers[name] = process

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
        """Of the processes that are watched, once they are started."""
        pids = {name: process.pid for name, process in self._helpers.items()}
        return {name: pid for name, pid in pids.items() if pid is not None}

    def poll(self) -> None:
        """See whether a process has ended, and send what one had no room for."""
        for name, process in self._helpers.items():
            process.resend()
            if process.exit_code is not None:
                self._fail(f"the helper process {name} ended unasked; see {self.logs}")
