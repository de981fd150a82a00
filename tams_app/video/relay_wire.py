"""What the relay reports to the session: packets and its own counts."""

from __future__ import annotations

import select
import socket
import time
from dataclasses import dataclass, replace

from tams_app.records import PacketRecord
from tams_app.runtime.clock import NS_PER_S
from tams_app.video.reporting_helper import line_of

# A session that stalls for a minute at 1000 packets/s leaves no gap in its records.
REPORT_BUFFER_BYTES = 15_000_000


@dataclass(slots=True)
class RelayStatistics:
    """What the relay counted since its start; the relay's own is the only one that ever changes."""

    sent: int = 0  # datagrams handed on, both directions
    late: int = 0  # of these, more than 1 ms after their time
    lateness_total_ns: int = 0
    lateness_max_ns: int = 0
    unsent: int = 0  # the system refused to send them
    overrun: int = 0  # lost before the relay, its socket buffers being full
    unreported: int = 0  # records left out because the session did not read them in time
    nacks: int = 0  # feedback messages on their way back
    plis: int = 0


@dataclass(frozen=True, slots=True)
class RelayReport:
    """The fates of the packets since the last report, and the counts."""

    packets: list[PacketRecord]
    statistics: RelayStatistics


class ReportStream:
    """Records on their way to the session; never waits, and counts what found no room.

    `connection` becomes non-blocking. Bytes the session has not read stay here, up to
    `REPORT_BUFFER_BYTES`; beyond that whole reports are left out.
    """

    def __init__(self, connection: socket.socket) -> None:
        connection.setblocking(False)
        self._connection = connection
        self._unsent = bytearray()
        self._gone = False
        self.unreported = 0

    def put(self, records: list[PacketRecord], statistics: RelayStatistics) -> None:
        """Queue one report and send what the connection takes."""
        counted = replace(statistics, unreported=self.unreported)
        line = line_of(RelayReport(records, counted))
        if self._gone or len(self._unsent) + len(line) > REPORT_BUFFER_BYTES:
            self.unreported += len(records)
        else:
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
