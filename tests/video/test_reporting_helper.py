"""What a helper says arrives to its last byte, however it ends; the relay never waits for that."""

from __future__ import annotations

import socket
import threading
from collections.abc import Iterator
from contextlib import suppress

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.records import PacketFate, PacketKind, PacketRecord
from tams_app.video.live.relay import REPORT_BUFFER_BYTES, ReportStream
from tams_app.video.live.reporting_helper import decoded, line_of, received

pytestmark = pytest.mark.waiting

Pair = tuple[socket.socket, socket.socket]


@pytest.fixture
def ends() -> Iterator[Pair]:
    """The session's end and the helper's."""
    session, helper = socket.socketpair()
    with session, helper:
        yield session, helper


def test_a_reset_is_an_end_like_any_other(ends: Pair) -> None:
    session, helper = ends
    session.sendall(b"unread")  # which makes the close a reset
    helper.close()
    assert list(received(session, threading.Event())) == []


def test_after_a_stop_it_ends_once_nothing_more_is_said(ends: Pair) -> None:
    session, helper = ends
    helper.sendall(b"still on its way")
    stop = threading.Event()
    stop.set()
    assert b"".join(received(session, stop)) == b"still on its way"


def test_silence_alone_ends_nothing_and_what_is_said_before_hanging_up_is_heard(ends: Pair) -> None:
    session, helper = ends
    stop = threading.Event()

    def speak_late() -> None:
        stop.wait(0.5)  # longer than it waits at once
        helper.sendall(b"late")
        helper.close()

    speaker = threading.Thread(target=speak_late)
    speaker.start()
    heard = list(received(session, stop))
    speaker.join()
    assert heard == [b"late"]


# --- reports as bytes, and the relay's way to send them ------------------------------------------

times = st.integers(0, 2**63)

records = st.builds(
    PacketRecord,
    view=st.sampled_from(("eih", "gt", "gs")),
    kind=st.sampled_from(list(PacketKind)),
    sequence=st.integers(0, 65_535),
    size_bytes=st.integers(28, 65_535),
    entered_ns=times,
    departed_ns=times,
    delivered_ns=times,
    fate=st.sampled_from(list(PacketFate)),
    rtp_timestamp=st.integers(0, 2**32 - 1),
)
reports = st.lists(records, max_size=4)


@given(st.lists(reports, max_size=4), st.integers(1, 60))
def test_what_was_sent_is_read_back_however_the_bytes_arrive(sent, length):
    stream = b"".join(map(line_of, sent))
    pieces = [stream[start : start + length] for start in range(0, len(stream), length)]
    assert list(decoded(pieces, list[PacketRecord])) == sent
    assert list(decoded([stream[:-1]], list[PacketRecord])) == sent[:-1]  # cut short


RECORD = PacketRecord("eih", PacketKind.MEDIA, 1, 100, 1, 2, 3, PacketFate.DELIVERED)
BATCH = [RECORD] * 10_000


def test_a_session_that_does_not_read_costs_bounded_memory_and_gets_the_rest_later(
    ends: Pair,
) -> None:
    session, relay = ends
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


def test_the_end_of_a_long_report_needs_no_further_report(ends: Pair) -> None:
    session, relay = ends
    stream = ReportStream(relay)
    session.settimeout(5)
    stream.put(BATCH)  # more than the connection takes at once
    assert stream._unsent

    def pieces():
        while True:
            yield session.recv(1 << 20)
            stream.flush()

    assert next(decoded(pieces(), list[PacketRecord])) == BATCH


def test_a_session_that_is_gone_does_not_end_the_relay(ends: Pair) -> None:
    session, relay = ends
    stream = ReportStream(relay)
    session.close()
    for _ in range(3):
        stream.put([RECORD])
    stream.close()
