"""A helper process that reports to the session through a socket pair, which no other can join.

A report is a dataclass, sent as one line of JSON (`line_of`).
"""

from __future__ import annotations

import socket
import threading
from collections.abc import Callable, Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any, Generic, TypeVar

import msgspec

from tams_app.errors import HelperError
from tams_app.runtime.process import HelperProcess
from tams_app.runtime.worker import Worker

_READ_TIMEOUT_S = 0.2  # how late a stop may be noticed
_READ_BYTES = 1 << 16

Report = TypeVar("Report")


class ReportingHelper(Generic[Report]):
    """One helper process and the thread that reads its reports, which are of `report_type`.

    `on_report` and `on_failure` are called in that thread; a helper that ends unasked is a failure,
    which `ended_unasked` states in one sentence.
    """

    def __init__(
        self,
        name: str,
        module: str,
        *,
        log_directory: Path | None,
        report_type: type[Report],
        on_report: Callable[[Report], None],
        on_failure: Callable[[str, BaseException], None],
        ended_unasked: str,
        stop_timeout_s: float = 3.0,
    ) -> None:
        self.process: HelperProcess | None = None
        self._name, self._module, self._log_directory = name, module, log_directory
        self._report_type, self._on_report = report_type, on_report
        self._ended_unasked = ended_unasked
        self._stop_timeout_s = stop_timeout_s
        self._reader = Worker(f"{name}-reports", self._read, on_failure)
        self._connection: socket.socket | None = None
        self._closing = False

    def start(self, specification: dict[str, Any]) -> dict[str, Any]:
        """Start it and wait: `launch`, then `wait_ready`; closed again if it cannot start."""
        try:
            self.launch(specification)
            return self.wait_ready()
        except BaseException:
            self.close()
            raise

    def launch(self, specification: dict[str, Any]) -> HelperProcess:
        """Start it, without waiting, with `specification` and the key `reports`.

        HelperError if it cannot be started.
        """
        self._connection, theirs = socket.socketpair()
        with theirs:  # which the helper inherits; closed here, so that its end is noticed
            specification = {**specification, "reports": theirs.fileno()}
            self.process = HelperProcess(
                self._name, self._module, specification, self._log_directory, (theirs.fileno(),)
            )
            self.process.start()
        return self.process

    def wait_ready(self) -> dict[str, Any]:
        """The object of its ready line, once it is launched; HelperError if it cannot start."""
        assert self.process is not None, "launch it first"
        ready = self.process.wait_ready()
        self._reader.start()
        return ready

    def close(self) -> None:
        """End the process and read what it still has to report; may be called twice."""
        self._closing = True
        if self.process is not None:
            self.process.stop(self._stop_timeout_s)
        self._reader.stop()
        if self._connection is not None:
            self._connection.close()

    def _read(self, stop: threading.Event) -> None:
        assert self._connection is not None
        for report in decoded(received(self._connection, stop), self._report_type):
            self._on_report(report)
        if not self._closing:
            raise HelperError(self._ended_unasked)


def reports_to_session(specification: Mapping[str, Any], timeout_s: float) -> socket.socket:
    """The helper's end, in its process; `timeout_s`: how long a report may wait, 0: it does not.

    Once the session is gone, a report is a BrokenPipeError.
    """
    reports = socket.socket(fileno=int(specification["reports"]))
    reports.settimeout(timeout_s)
    return reports


def received(connection: socket.socket, stop: threading.Event) -> Iterator[bytes]:
    """The bytes as they come; sets the connection's timeout.

    Ends when the helper has disconnected or, after a stop, has nothing more to say.
    """
    connection.settimeout(_READ_TIMEOUT_S)
    while True:
        try:
            data = connection.recv(_READ_BYTES)
        except TimeoutError:
            if stop.is_set():
                return
            continue
        except ConnectionResetError:
            return
        if not data:
            return
        yield data


def line_of(report: object) -> bytes:
    return msgspec.json.encode(report) + b"\n"


def decoded(pieces: Iterable[bytes], report_type: type[Report]) -> Iterator[Report]:
    """The reports of a byte stream that arrives in any pieces."""
    decode, unread = msgspec.json.Decoder(report_type).decode, b""
    for piece in pieces:
        *lines, unread = (unread + piece).split(b"\n")
        yield from map(decode, lines)
