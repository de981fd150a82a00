"""The application's side of the bridge to ROS 2: hands records over, receives the emergency stop.

Nothing here waits for the bridge's process, and nothing that becomes of it ends a session.
"""

from __future__ import annotations

import select
import socket
import threading
from collections.abc import Callable
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from tams_app.errors import HelperError, SetupError, require_extra
from tams_app.recording import Header, Viewer
from tams_app.records import TakeNote
from tams_app.ros2.wire import EMERGENCY_STOP, STOP, encode
from tams_app.runtime.clock import Clock
from tams_app.runtime.process import HelperProcess
from tams_app.runtime.worker import Worker
from tams_app.units import NS_PER_S

_POLL_S = 0.2
_SEND_BUFFER_BYTES = 1 << 20  # as far as the system allows: what waits for the process at most


class Ros2Bridge(Viewer):
    """Hands records to the bridge's process; `end` it after the log, which it outlives.

    `dropped`: records that found the socket full.
    """

    def __init__(self, domain: int, header: Header, clock: Clock, log_directory: Path) -> None:
        """Start its process and wait until DDS works; SetupError in one sentence if it does not."""
        require_extra("ros2", "--ros2")
        self.dropped = 0
        self._clock = clock
        self._gone = False
        self._listener: Worker | None = None
        with ExitStack() as stack:
            ours, theirs = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
            stack.callback(ours.close)
            ours.setblocking(False)
            ours.setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
            with theirs:
                self._process = HelperProcess(
                    "ros2",
                    "tams_app.session.ros2_process",
                    {"socket": theirs.fileno(), "domain": domain, "views": header.views},
                    log_directory,
                    (theirs.fileno(),),
                )
                stack.callback(self._process.stop)
                self._process.start()
            try:
                self._process.wait_ready()
            except HelperError as error:
                raise SetupError(f"{error}; leave out --ros2 to go without") from error
            self._socket = ours
            self._stack = stack.pop_all()
        self.receive(header)

    @property
    def pid(self) -> int | None:
        """Of the bridge's process; None once it has ended."""
        return self._process.pid if self._process.exit_code is None else None

    def listen(self, estop: Callable[[], None], note: TakeNote) -> None:
        """From now on call `estop` when ROS asks for it, and `note` what becomes of the bridge."""

        def fails(_name: str, failure: BaseException) -> None:
            note("warning", f"the ROS 2 bridge is not heard any more: {failure!r}")

        self._listener = Worker("ros2", lambda stop: self._listen(estop, note, stop), fails)
        self._listener.start()

    def receive(self, record: Any) -> None:
        """Hand over a record, if it is one that ROS 2 receives; at once, or not at all."""
        if self._gone or (content := encode(record)) is None:
            return
        try:
            self._socket.send(content)
        except ConnectionError:
            self._gone = True
        except OSError:  # full, or a frame that is too long for it
            self.dropped += 1

    def stop_listening(self) -> None:
        """Before the log ends, so that it has what became of the bridge."""
        if self._listener is not None:
            self._listener.stop()

    def end(self) -> None:
        """Let the process publish what it has, and end it; may be called twice."""
        self._stack.close()

    def _listen(self, estop: Callable[[], None], note: TakeNote, stop: threading.Event) -> None:
        drops_reported, next_note_ns = False, self._clock.now_ns()
        while not stop.is_set():
            if self.dropped and not drops_reported:
                drops_reported = True
                note("warning", "the ROS 2 bridge is too slow: records are missing in ROS 2")
            if not select.select([self._socket], [], [], _POLL_S)[0]:
                continue
            if self._read() != STOP:
                note(
                    "warning",
                    "the ROS 2 bridge has ended: nothing is published any more, and "
                    f"{EMERGENCY_STOP} stops nothing; the session goes on without it",
                )
                break
            estop()
            now_ns = self._clock.now_ns()
            if now_ns >= next_note_ns:
                next_note_ns = now_ns + NS_PER_S
                note("warning", f"emergency stop, asked for in ROS 2 ({EMERGENCY_STOP})")
        if self.dropped:
            note("warning", f"records that ROS 2 was not told of until now: {self.dropped}")

    def _read(self) -> bytes:
        try:
            return self._socket.recv(len(STOP))
        except ConnectionError:
            return b""
