"""The relay's reports: the relay never waits for the session that reads them."""

import socket
from contextlib import suppress

import pytest

from tams_app.records import PacketFate, PacketKind, PacketRecord
from tams_app.video.live.relay import REPORT_BUFFER_BYTES, ReportStream
from tams_app.video.live.reporting_helper import decoded, line_of

pytestmark = pytest.mark.waiting

RECORD = PacketRecord("eih", PacketKind.MEDIA, 1, 100, 1, 2, 3, PacketFate.DELIVERED)
BATCH = [RECORD] * 10_000


@pytest.fixture
def ends():
    relay, session = socket.socketpair()
    session.settimeout(5)
    with relay, session:
        yield relay, session


def test_a_session_that_does_not_read_costs_bounded_memory_and_gets_the_rest_later(ends):
    relay, session = ends
    stream = ReportStream(relay)
    for _ in range(2 * REPORT_BUFFER_BYTES // len(line_of(BATCH))):  # never waits
        stream.put(BATCH)
    assert len(stream._unsent) <= REPORT_BUFFER_BYTES
    session.settimeout(0.01)
    received = []

    def pieces():
        while not received or received[-1] != [RECORD]:
            stream.put([RECORD])  # sends on what waited, too
            with suppress(TimeoutError):
                yield session.recv(1 << 20)

    received.extend(decoded(pieces(), list[PacketRecord]))
    assert received.count(BATCH) * len(line_of(BATCH)) > 0.8 * REPORT_BUFFER_BYTES


def test_the_end_of_a_long_report_needs_no_further_report(ends):
    relay, session = ends
    stream = ReportStream(relay)
    stream.put(BATCH)  # more than the connection takes at once
    assert stream._unsent

    def pieces():
        while True:
            yield session.recv(1 << 20)
            stream.flush()

    assert next(decoded(pieces(), list[PacketRecord])) == BATCH


def test_a_session_that_is_gone_does_not_end_the_relay(ends):
    relay, session = ends
    stream = ReportStream(relay)
    session.close()
    for _ in range(3):
        stream.put([RECORD])
    stream.close()
