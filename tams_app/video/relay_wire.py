"""The relay's reports on their way to the session: lists of packet records."""

from __future__ import annotations

import select
import socket
import time

from tams_app.records import PacketRecord
from tams_app.units import NS_PER_S
from tams_app.video.reporting_helper import line_of

# A session that stalls for a minute at 1000 packets/s leaves no gap in its records.
REPORT_BUFFER_BYTES = 15_000_000


class ReportStream:
    """Records on their way to the session; never waits.

    `connection` becomes non-blocking. Bytes the session has not read stay here, up to
    `REPORT_BUFFER_BYTES`; beyond that whole reports are left out.
    """

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        self._connection = connection
        self._unsent = bytearray()
        self._gone = False

    def put(self, records: list[PacketRecord]) -> None:
        """Queue one report and send what the connection takes."""
        line = line_of(records)
        if not self._gone and len(self._unsent) + len(line) <= REPORT_BUFFER_BYTES:
            self._unsent += line
        self._send()

    def _send(self) -> None:
        while self._unsent and not self._gone:
            try:
                sent = self._connection.send(self._unsent)
            except BlockingIOError:
                return
            except (BrokenPipeError, ConnectionResetError):
                self._gone = True  # the session closes the relay itself; video goes on till then
                return
            del self._unsent[:sent]

    def close(self, timeout_s: float = 0.5) -> None:
        """Send the rest, for at most `timeout_s`, and disconnect."""
        deadline_ns = time.monotonic_ns() + round(timeout_s * NS_PER_S)
        self._send()
        while self._unsent and not self._gone and time.monotonic_ns() < deadline_ns:
            select.select([], [self._connection], [], timeout_s)
            self._send()
        self._connection.close()
