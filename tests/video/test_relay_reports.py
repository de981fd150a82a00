"""The relay's reports: the relay never waits for the session that reads them."""

import socket
from contextlib import suppress

import pytest

from tams_app.records import PacketFate, PacketKind, PacketRecord
from tams_app.video.relay_wire import (
    REPORT_BUFFER_BYTES,
    RelayReport,
    RelayStatistics,
    ReportStream,
)
from tams_app.video.reporting_helper import decoded

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


def test_reports_arrive_with_the_statistics(ends):
    relay, session = ends
    ReportStream(relay).put([RECORD], STATISTICS)
    reports = decoded(iter(lambda: session.recv(1 << 16), b""), RelayReport)
    assert next(reports) == RelayReport([RECORD], STATISTICS)


def test_a_session_that_does_not_read_costs_bounded_memory_and_is_told_what_it_missed(ends):
    relay, session = ends
    stream = ReportStream(relay)
    accepted = 0
    while stream.unreported < 3 * len(BATCH):  # would never return if `put` waited
        before = stream.unreported
        stream.put(BATCH, STATISTICS)
        accepted += stream.unreported == before
    assert accepted * len(BATCH) * 100 < REPORT_BUFFER_BYTES + (16 << 20)
    session.settimeout(0.01)
    received = []

    def pieces():
        while not received or received[-1].packets != [RECORD]:
            stream.put([RECORD], STATISTICS)  # sends on what waited, too
            with suppress(TimeoutError):
                yield session.recv(1 << 20)

    for report in decoded(pieces(), RelayReport):
        received.append(report)
    assert sum(report.packets == BATCH for report in received) == accepted
    assert received[-1].statistics.unreported >= 3 * len(BATCH)


def test_a_session_that_is_gone_does_not_end_the_relay(ends):
    relay, session = ends
    stream = ReportStream(relay)
    session.close()
    for _ in range(3):
        stream.put([RECORD], STATISTICS)
    assert stream.unreported >= 1
    stream.close()
