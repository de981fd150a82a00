"""Keeps the computer from being suspended while a session runs, by systemd's inhibitor locks.

logind grants and ends them; `systemd-inhibit` asks for one, holds it while its child runs, and
needs no library of ours. The child is `cat`, which ends with our end of its pipe, so also with a
killed session.
"""

from __future__ import annotations

import contextlib
import subprocess
import threading
from collections.abc import Callable, Sequence

from tams_app.runtime.worker import Worker

INHIBIT = (
    "systemd-inhibit",
    "--what=sleep:idle:handle-lid-switch",
    "--who=TAMS",
    "--why=a session runs, its arm may move",
    "--mode=block",
    "cat",
)
_END_S = 2.0


class KeptAwake:
    """From `start` to `close`; `notify` gets a sentence if the computer may sleep after all."""

    def __init__(self, notify: Callable[[str], None], command: Sequence[str] = INHIBIT) -> None:
        self._notify, self._command = notify, command
        self._process: subprocess.Popen[bytes] | None = None
        self._worker = Worker("awake", self._watch)
        self._closing = False
        self.held = False  # the lock was granted

    def start(self) -> None:
        """Ask for the lock, without waiting for it."""
        try:
            self._process = subprocess.Popen(
                self._command,
                stdin=subprocess.PIPE,
                stdout=subprocess.PIPE,
                stderr=subprocess.DEVNULL,
                bufsize=0,  # nothing is left to write when it is closed after the child's end
                start_new_session=True,  # it must ask no password on our terminal
            )
        except OSError:
            self._notify(_not_kept("systemd-inhibit is not there"))
            return
        if self._process.stdin is not None:
            with contextlib.suppress(BrokenPipeError):  # it has ended already: reading shows it
                self._process.stdin.write(b"\n")  # comes back from the child, once it has the lock
        self._worker.start()

    def close(self) -> None:
        """Let go of the lock; may be called twice."""
        process, self._process = self._process, None
        self._closing = True
        if process is None:
            return
        if process.stdin is not None:
            process.stdin.close()
        try:
            process.wait(_END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        self._worker.stop(_END_S)
        if process.stdout is not None:
            process.stdout.close()

    def _watch(self, _stop: threading.Event) -> None:
        process = self._process
        if process is None or process.stdout is None:
            return
        self.held = process.stdout.readline() != b""
        while process.stdout.readline():
            pass
        if not self._closing:
            self._notify(_not_kept("the lock was lost" if self.held else "logind refuses the lock"))


def _not_kept(why: str) -> str:
    return (
        f"nothing keeps this computer from being suspended ({why}): see that it does not sleep "
        "while a session runs"
    )
