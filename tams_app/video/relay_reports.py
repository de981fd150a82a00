"""The relay's reports on their way to the session, which may be slow or gone."""

from __future__ import annotations

import select
import socket
import time
from dataclasses import replace

from tams_app.records import PacketRecord
from tams_app.runtime.clock import NS_PER_S
from tams_app.video.relay_wire import RelayStatistics, encode_batch

# A session that stalls for a minute at 1000 packets/s leaves no gap in its records.
REPORT_BUFFER_BYTES = 4_000_000


class ReportStream:
    """Records on their way to the session; never waits, and counts what found no room.

    `connection` becomes non-blocking. Bytes the session has not read stay here, up to
    `REPORT_BUFFER_BYTES`; beyond that whole batches are left out.
    """

    def __init__(self, connection: socket.socket, views: tuple[str, ...]) -> None:
        connection.setblocking(False)
        self._connection = connection
        self._views = views
        self._unsent = bytearray()
        self._gone = False
        self.unreported = 0

    def put(self, records: list[PacketRecord], statistics: RelayStatistics) -> None:
        """Queue one batch and send what the connection takes."""
        counted = replace(statistics, unreported=self.unreported)
        batch = encode_batch(self._views, records, counted)
        if self._gone or len(self._unsent) + len(batch) > REPORT_BUFFER_BYTES:
            self.unreported += len(records)
        else:
            self._unsent += batch
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
        """Send the rest, for at most `timeout_s`, and hang up."""
        deadline_ns = time.monotonic_ns() + round(timeout_s * NS_PER_S)
        self._send()
        while self._unsent and not self._gone and time.monotonic_ns() < deadline_ns:
            select.select([], [self._connection], [], timeout_s)
            self._send()
        self._connection.close()
