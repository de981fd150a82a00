"""The byte format in which the relay reports packets and its own counts to the session.

A batch is a header (record count, then the fields of `RelayStatistics`) and fixed-size records;
views travel as their place in the list that both sides know.
"""

from __future__ import annotations

import select
import socket
import struct
import time
from collections.abc import Sequence
from dataclasses import astuple, dataclass, replace

from tams_app.records import PacketFate, PacketKind, PacketRecord
from tams_app.units import NS_PER_S

# A session that stalls for a minute at 1000 packets/s leaves no gap in its records.
REPORT_BUFFER_BYTES = 4_000_000

_HEADER = struct.Struct("<I9Q")
_RECORD = struct.Struct("<BBHHQQQBI")  # in the order of PacketRecord
_KINDS = {kind.value: kind for kind in PacketKind}
_FATES = {fate.value: fate for fate in PacketFate}


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


def encode_batch(
    views: Sequence[str], records: Sequence[PacketRecord], statistics: RelayStatistics
) -> bytes:
    """One batch; every record's view must be in `views`."""
    place = {view: index for index, view in enumerate(views)}
    parts = [_HEADER.pack(len(records), *astuple(statistics))]
    parts += [
        _RECORD.pack(
            place[record.view],
            record.kind.value,
            record.sequence,
            record.size_bytes,
            record.entered_ns,
            record.departed_ns,
            record.delivered_ns,
            record.fate.value,
            record.rtp_timestamp,
        )
        for record in records
    ]
    return b"".join(parts)


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


class BatchDecoder:
    """Puts batches together from a byte stream that arrives in any pieces."""

    def __init__(self, views: Sequence[str]) -> None:
        self._views = tuple(views)
        self._pending = bytearray()

    def feed(self, data: bytes) -> list[tuple[list[PacketRecord], RelayStatistics]]:
        """The batches that `data` completes."""
        self._pending += data
        batches = []
        while (batch := self._next()) is not None:
            batches.append(batch)
        return batches

    def _next(self) -> tuple[list[PacketRecord], RelayStatistics] | None:
        if len(self._pending) < _HEADER.size:
            return None
        count, *counts = _HEADER.unpack_from(self._pending)
        end = _HEADER.size + count * _RECORD.size
        if len(self._pending) < end:
            return None
        body = bytes(self._pending[_HEADER.size : end])
        del self._pending[:end]
        return [self._record(fields) for fields in _RECORD.iter_unpack(body)], RelayStatistics(
            *counts
        )

    def _record(self, fields: tuple[int, ...]) -> PacketRecord:
        view, kind, sequence, size_bytes, entered, departed, delivered, fate, timestamp = fields
        return PacketRecord(
            self._views[view],
            _KINDS[kind],
            sequence,
            size_bytes,
            entered,
            departed,
            delivered,
            _FATES[fate],
            timestamp,
        )
