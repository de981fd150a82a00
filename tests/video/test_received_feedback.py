"""Each packet once, in the order of sending, at a time that makes sense."""

from __future__ import annotations

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.records import PacketArrival
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.packets import SEQUENCES
from tams_app.video.core.received_feedback import ReceivedFeedback, uplink_report
from tams_app.video.core.rtcp import ReportBlock

pytestmark = pytest.mark.untimed

SSRC = 7
NOW_NS = 5_000 * NS_PER_S
WRAP_NS = 65536 * 250_000
NO_TIME_NS = 2**64 - 1  # GStreamer's, of a packet that the session does not know


def received() -> ReceivedFeedback:
    return ReceivedFeedback("eih", SSRC)


def packets(numbers: range) -> list[tuple[int, int, int]]:
    """Three packets leave at once, every 30 ms."""
    return [
        (number % SEQUENCES, NOW_NS + number // 3 * 30 * NS_PER_MS, 1000 + number % 7)
        for number in numbers
    ]


def tell(one: ReceivedFeedback, numbers: range, lost: set[int], transit_ns: int = 0) -> None:
    rows = packets(numbers)
    came = {row[0]: row[1] + transit_ns for row in rows if row[0] not in lost}
    one.report(rows[-1][1] + 100 * NS_PER_MS, rows, came)


def test_what_arrived_and_what_was_lost_is_told_in_the_order_of_sending():
    one = received()
    tell(one, range(6), {1, 2}, 40)
    assert one.take_arrivals() == [
        PacketArrival("eih", sent_ns, size, None if number in (1, 2) else sent_ns + 40)
        for number, sent_ns, size in packets(range(6))
    ]
    assert one.take_arrivals() == []


@given(
    st.lists(st.tuples(st.integers(0, 200), st.integers(1, 40)), min_size=1, max_size=20),
    st.integers(0, SEQUENCES),
)
def test_no_packet_is_told_twice_however_feedback_is_repeated_or_reordered(messages, shift):
    one = received()
    for first, count in messages:
        tell(one, range(shift + first, shift + first + count), set())
    told = one.take_arrivals()
    assert len(told) >= messages[0][1]
    keys = [(arrival.sent_ns, arrival.size_bytes) for arrival in told]
    assert len(set(keys)) == len(keys)
    assert [sent_ns for sent_ns, _ in keys] == sorted(sent_ns for sent_ns, _ in keys)


@given(st.integers(-100, 100), st.integers(0, 2_000))
def test_arrivals_go_on_where_the_time_of_the_receiver_wraps(wraps, later_ms):
    one = received()
    offset_ns = 123 * NS_PER_S
    tell(one, range(3), set(), offset_ns)
    tell(one, range(3, 6), set(), offset_ns + wraps * WRAP_NS + later_ms * NS_PER_MS)
    transits = [
        arrival.arrived_ns - arrival.sent_ns - offset_ns
        for arrival in one.take_arrivals()
        if arrival.arrived_ns is not None
    ]
    assert transits == [0] * 3 + [later_ms * NS_PER_MS] * 3


@pytest.mark.parametrize("sent_ns", [NO_TIME_NS, NOW_NS - 11 * NS_PER_S])
def test_a_packet_that_the_session_does_not_know_or_mistakes_for_an_old_one_is_left_out(sent_ns):
    one = received()
    one.report(NOW_NS, [(3, sent_ns, 500), (4, NOW_NS - 1, 600)], {3: 1, 4: 2})
    assert [arrival.size_bytes for arrival in one.take_arrivals()] == [600]


def test_the_report_of_all_views_is_in_the_order_of_sending():
    one, other = received(), ReceivedFeedback("gt", 9)
    one.report(NOW_NS, [(0, NOW_NS - 30, 1), (1, NOW_NS - 10, 2)], {0: 1, 1: 1})
    other.report(NOW_NS, [(0, NOW_NS - 20, 3)], {0: 1})
    report = uplink_report(NOW_NS, 99, (one, other))
    assert [arrival.size_bytes for arrival in report.arrivals] == [1, 3, 2]
    assert (report.now_ns, report.sent_bytes, report.receptions) == (NOW_NS, 99, ())
    assert uplink_report(NOW_NS, 99, (one, other)).arrivals == ()


def test_a_reception_counts_the_losses_since_the_report_before():
    one = received()
    one.blocks([ReportBlock(SSRC, 65_537, 65_539, 0, None)])
    assert one.take_reception() is None
    one.blocks([ReportBlock(SSRC, 65_547, 65_639, 900, None)])
    first = one.take_reception()
    one.blocks([ReportBlock(SSRC, 65_552, 65_659, 900, 80)])
    one.blocks([ReportBlock(8, 500, 9_999, 0, 80), ReportBlock(SSRC, 65_557, 65_679, 1800, 90)])
    second = one.take_reception()
    assert (first.fraction_lost, first.round_trip_ns, first.jitter_ns) == (0.1, None, 10**7)
    assert (second.fraction_lost, second.round_trip_ns, second.jitter_ns) == (0.25, 90, 2 * 10**7)
    assert one.take_reception() is None


@given(st.lists(st.tuples(st.integers(-50, 500), st.integers(0, 500)), min_size=1))
def test_a_fraction_lost_is_one_whatever_a_receiver_claims(claims):
    one = received()
    for lost, highest in claims:
        one.blocks([ReportBlock(SSRC, lost, highest, 0, None)])
        reception = one.take_reception()
        assert reception is None or 0 <= reception.fraction_lost <= 1
