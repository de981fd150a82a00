"""Helper processes: started, watched and ended by the session; and the helper's own side of it.

A helper prints one JSON line when it is ready. Its standard input is a pipe from the session, which
may send it something on the way, a JSON line each: when it closes, however the session died, the
helper ends. Helpers live in a session of their own: what the terminal does to the application
(Ctrl-C, Ctrl-Z, hanging up) does not reach them, the guard least of all.
"""

from __future__ import annotations

import contextlib
import json
import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

from tams_app.errors import HelperError, TamsError
from tams_app.runtime.realtime import ordinary_meanwhile

READY_TIMEOUT_S = 30.0
PROJECT_DIRECTORY = Path(__file__).resolve().parents[2]


class HelperProcess:
    """One child process running `python -m module` with its specification as a JSON argument."""

    def __init__(
        self,
        name: str,
        module: str,
        specification: dict[str, Any],
        log_directory: Path | None,
        descriptors: Sequence[int] = (),
    ) -> None:
        """`descriptors`: of open files that the child has under the same numbers."""
        self.name = name
        self._descriptors = tuple(descriptors)
        self._command = [sys.executable, "-m", module, json.dumps(specification)]
        self._log_path = log_directory / f"{name}.log" if log_directory else None
        self._process: subprocess.Popen[bytes] | None = None
        self._unsent = b""

    def start(self) -> None:
        """Start the process without waiting; see `wait_ready`."""
        stderr = None
        try:
            stderr = self._log_path.open("ab") if self._log_path else None
            with ordinary_meanwhile():  # what it loads must not hold up the machine
                self._process = subprocess.Popen(
                    self._command,
                    stdin=subprocess.PIPE,
                    stdout=subprocess.PIPE,
                    stderr=stderr,
                    cwd=PROJECT_DIRECTORY,
                    start_new_session=True,
                    pass_fds=self._descriptors,
                )
            assert self._process.stdin is not None
            os.set_blocking(self._process.stdin.fileno(), False)
        except OSError as error:
            raise HelperError(f"{self.name} could not be started: {error.strerror}") from error
        finally:
            if stderr is not None:
                stderr.close()

    def wait_ready(self) -> dict[str, Any]:
        """The JSON object of the helper's ready line; HelperError if none comes in time."""
        process = self._process
        if process is None or process.stdout is None:
            raise HelperError(f"{self.name} was not started")
        line = b""
        stdout = process.stdout

        def read() -> None:
            nonlocal line
            line = stdout.readline()

        reader = threading.Thread(target=read, name=f"{self.name}-ready", daemon=True)
        reader.start()
        reader.join(READY_TIMEOUT_S)
        if reader.is_alive():
            raise HelperError(
                f"{self.name} was not ready within {READY_TIMEOUT_S:g} s{self._where()}"
            )
        try:
            ready = json.loads(line)
        except ValueError as error:
            raise HelperError(f"{self.name} could not start{self._where()}") from error
        if "error" in ready:
            raise HelperError(str(ready["error"]))
        return dict(ready)

    def send(self, **facts: Any) -> None:
        """Hand `facts` to the helper, which knows only what it received last; never waits.

        From a helper that stands still so long that its pipe is full, they are kept until it goes
        on or newer ones take their place. What it does not do meanwhile is noticed as that: frames
        that do not come, an arm that does not answer.
        """
        self._unsent = json.dumps(facts).encode() + b"\n"
        self.resend()

    def resend(self) -> None:
        """Hand over what there was no room for, if there is now; never waits."""
        process, unsent = self._process, self._unsent
        if not unsent or process is None or process.stdin is None or process.stdin.closed:
            return
        # there is no room, or it has ended, which its owner notices
        with contextlib.suppress(BlockingIOError, BrokenPipeError):
            os.write(process.stdin.fileno(), unsent)  # up to PIPE_BUF: whole or not at all
            if self._unsent is unsent:  # else another thread has something newer
                self._unsent = b""

    @property
    def pid(self) -> int | None:
        return self._process.pid if self._process else None

    @property
    def exit_code(self) -> int | None:
        """None while it runs or before it was started."""
        return self._process.poll() if self._process else None

    def stop(self, timeout_s: float = 3.0) -> None:
        """End it: close its input, then SIGTERM, then SIGKILL; may be called twice."""
        process = self._process
        if process is None:
            return
        if process.stdin and not process.stdin.closed:
            process.stdin.close()
        for force in (None, signal.SIGTERM, signal.SIGKILL):
            if force is not None:
                process.send_signal(force)
            try:
                process.wait(timeout_s / 3)
                break
            except subprocess.TimeoutExpired:
                continue
        if process.stdout and not process.stdout.closed:
            process.stdout.close()

    def _where(self) -> str:
        return f"; see {self._log_path}" if self._log_path else ""


class HelperSide:
    """The helper's side of its process: its specification, its ready line, its end."""

    def __init__(self) -> None:
        self.specification: dict[str, Any] = json.loads(sys.argv[1])
        self.received: dict[str, Any] = {}  # by the session, last
        self.stop_requested = threading.Event()
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        signal.signal(signal.SIGTERM, lambda *_: self.stop_requested.set())
        threading.Thread(target=self._watch_parent, name="parent-watch", daemon=True).start()

    def ready(self, **facts: Any) -> None:
        """Report to the session that this helper works, with what it needs (ports, names)."""
        self._write(facts)

    def fail(self, sentence: str) -> None:
        """Report to the session in one sentence why this helper cannot work; end after this."""
        self._write({"error": sentence})

    @contextlib.contextmanager
    def failing(self) -> Iterator[None]:
        """A `TamsError` inside is reported by `fail`, and ends the process with its exit code."""
        try:
            yield
        except TamsError as error:
            self.fail(str(error))
            raise SystemExit(error.exit_code) from error

    def _write(self, content: dict[str, Any]) -> None:
        sys.stdout.write(json.dumps(content) + "\n")
        sys.stdout.flush()

    def _watch_parent(self) -> None:
        # os.read, not sys.stdin: a buffered reader blocked at exit would abort the interpreter
        rest = b""
        while data := os.read(0, 4096):
            *lines, rest = (rest + data).split(b"\n")
            if lines:
                self.received = json.loads(lines[-1])
        self.stop_requested.set()
