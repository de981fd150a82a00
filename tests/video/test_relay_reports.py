"""The relay's reports: the relay never waits for the session that reads them."""

import socket
from contextlib import suppress

import pytest

from tams_app.records import PacketFate, PacketKind, PacketRecord
from tams_app.video.relay_wire import (
    REPORT_BUFFER_BYTES,
    BatchDecoder,
    RelayStatistics,
    ReportStream,
)

pytestmark = pytest.mark.waiting

RECORD = PacketRecord("eih", PacketKind.MEDIA, 1, 100, 1, 2, 3, PacketFate.DELIVERED)
BATCH = [RECORD] * 10_000
STATISTICS = RelayStatistics(sent=7)


@pytest.fixture
def ends():
    relay, session = socket.socketpair()
    session.settimeout(5)
    with relay, session:
        yield relay, session


def read(session, decoder, batches):
    received = []
    while len(received) < batches:
        received += decoder.feed(session.recv(1 << 16))
    return received


def test_reports_arrive_with_the_statistics(ends):
    relay, session = ends
    ReportStream(relay, ("eih",)).put([RECORD], STATISTICS)
    assert read(session, BatchDecoder(("eih",)), 1) == [([RECORD], STATISTICS)]


def test_a_session_that_does_not_read_costs_bounded_memory_and_is_told_what_it_missed(ends):
    relay, session = ends
    stream, decoder = ReportStream(relay, ("eih",)), BatchDecoder(("eih",))
    accepted = 0
    while stream.unreported < 3 * len(BATCH):  # would never return if `put` waited
        before = stream.unreported
        stream.put(BATCH, STATISTICS)
        accepted += stream.unreported == before
    assert accepted * len(BATCH) * 36 < REPORT_BUFFER_BYTES + (16 << 20)
    session.settimeout(0.01)
    received = []
    while not received or received[-1][0] != [RECORD]:
        stream.put([RECORD], STATISTICS)  # sends on what waited, too
        with suppress(TimeoutError):
            received += decoder.feed(session.recv(1 << 20))
    assert sum(records == BATCH for records, _ in received) == accepted
    assert received[-1][1].unreported >= 3 * len(BATCH)


def test_a_session_that_is_gone_does_not_end_the_relay(ends):
    relay, session = ends
    stream = ReportStream(relay, ("eih",))
    session.close()
    for _ in range(3):
        stream.put([RECORD], STATISTICS)
    assert stream.unreported >= 1
    stream.close()
