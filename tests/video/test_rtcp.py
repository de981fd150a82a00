"""What is read from a receiver's RTCP, and handed on: each packet once, at a sensible time."""

from __future__ import annotations

import struct
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.records import PacketArrival
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.packets import SEQUENCES
from tams_app.video.core.rtcp import (
    ARRIVAL_TICK_NS,
    ReceivedFeedback,
    ReportBlock,
    read_arrivals,
    read_blocks,
    uplink_report,
)

pytestmark = pytest.mark.untimed

UNIX_NTP_S = 2_208_988_800
# Written by GStreamer 1.22 with packets 25 to 41 of 22 to 59 lost, 2 ms from packet to packet.
WITH_A_LONG_GAP = bytes.fromhex(
    "8fcd000ce343c3615441000000160026000000022003001180"
    "0087ffbf80ce09099d090909080909090809090909080909090900"
)
SSRC = 7
NOW_NS = 5_000 * NS_PER_S
WRAP_NS = 65536 * 250_000
NO_TIME_NS = 2**64 - 1  # GStreamer's, of a packet that the session does not know


def written(
    first: int, reference: int, waits: list[int | None], *, runs: bool, gaps_twice: bool
) -> bytes:
    """A message about packets from `first` on: ticks since the one before, None for a lost one."""
    statuses = [0 if wait is None else 1 if 0 <= wait <= 255 else 2 for wait in waits]
    chunks, at = b"", 0
    while at < len(statuses):
        run = 1
        while at + run < len(statuses) and statuses[at + run] == statuses[at]:
            run += 1
        if run > 7 and statuses[at] == 0 and gaps_twice:
            chunks += struct.pack("!H", run)
            if run > 14:  # a whole vector, and the rest as a run
                chunks += struct.pack("!HH", 0xC000, run - 7)
                at += run
                continue
        elif run > 7 and runs:
            chunks += struct.pack("!H", statuses[at] << 13 | run)
            at += run
            continue
        vector = statuses[at : at + 7]
        shifted = [status << 12 - 2 * place for place, status in enumerate(vector)]
        chunks += struct.pack("!H", 0xC000 | sum(shifted))
        at += 7
    deltas = b"".join(
        wait.to_bytes() if 0 <= wait <= 255 else wait.to_bytes(2, signed=True)
        for wait in waits
        if wait is not None
    )
    return struct.pack("!HHI", first, len(waits), reference << 8) + chunks + deltas


def arrivals(first: int, reference: int, waits: list[int | None]) -> dict[int, int]:
    came, now_ns = {}, reference * 64 * NS_PER_MS
    for place, wait in enumerate(waits):
        if wait is not None:
            now_ns += wait * ARRIVAL_TICK_NS
            came[(first + place) % SEQUENCES] = now_ns
    return came


waits = st.lists(
    st.one_of(
        st.lists(st.none(), min_size=1, max_size=40),
        st.lists(st.integers(0, 255), min_size=1, max_size=20),
        st.lists(st.integers(-(2**15), 2**15 - 1), min_size=1, max_size=4),
    ),
    max_size=6,
).map(lambda parts: [*(wait for part in parts for wait in part), 3])  # the last one came


@given(st.integers(0, SEQUENCES - 1), st.integers(0, 2**24 - 1), waits, st.booleans())
def test_each_arrival_is_read_at_its_time_and_the_lost_are_absent(first, reference, waits, runs):
    message = written(first, reference, waits, runs=runs, gaps_twice=False)
    assert read_arrivals(message) == arrivals(first, reference, waits)


@given(st.integers(9, 40), st.integers(1, 30))
def test_a_long_gap_that_is_written_twice_is_read_once(lost, after):
    waits = [5] * 7 + [None] * lost + [300] * after
    message = written(100, 7, waits, runs=False, gaps_twice=True)
    assert read_arrivals(message) == arrivals(100, 7, waits)


def test_a_long_gap_as_gstreamer_writes_it_is_read_once():
    arrived_ns = read_arrivals(WITH_A_LONG_GAP[12:])
    assert list(arrived_ns) == [22, 23, 24, *range(42, 60)]
    times = list(arrived_ns.values())
    steps = {later - before for before, later in pairwise(times[3:])}
    assert steps == {8 * ARRIVAL_TICK_NS, 9 * ARRIVAL_TICK_NS}


@given(waits, st.data())
def test_a_message_that_is_cut_off_tells_nothing(waits, data):
    message = written(1, 2, waits, runs=True, gaps_twice=False)
    assert read_arrivals(message[: data.draw(st.integers(0, len(message) - 1))]) == {}


@given(st.binary(max_size=120))
def test_no_datagram_raises(datagram):
    read_arrivals(datagram)
    read_blocks(datagram, 0)
    read_blocks(b"\x82\xc9" + datagram, 0)


def report(wall_s: float, since_s: float, lost: int) -> bytes:
    last_report = round((UNIX_NTP_S + wall_s) * 65536) & 0xFFFFFFFF
    block = struct.pack(
        "!IIIIII", 0x54410000, lost & 0xFFFFFF, 70_000, 900, last_report, round(since_s * 65536)
    )
    return struct.pack("!BBHI", 0x81, 201, 7, 9) + block


def test_a_report_block_tells_losses_jitter_and_the_round_trip():
    (block,) = read_blocks(report(50.0, 0.25, 12), round(50.33 * NS_PER_S))
    assert (block.ssrc, block.lost, block.highest_sequence, block.jitter) == (
        0x54410000,
        12,
        70_000,
        900,
    )
    assert block.round_trip_ns == pytest.approx(80 * NS_PER_MS, abs=2 * NS_PER_S / 65536)


@pytest.mark.parametrize("heard_s", [40.0, 70.0])
def test_after_the_clock_was_set_no_round_trip_is_told_and_a_loss_may_be_negative(heard_s):
    (block,) = read_blocks(report(50.0, 0.0, -2), round(heard_s * NS_PER_S))
    assert (block.lost, block.round_trip_ns) == (-2, None)  # more packets than expected


def test_without_a_report_of_the_sender_there_is_no_round_trip():
    packet = struct.pack("!BBHI", 0x81, 201, 7, 9) + struct.pack("!IIIIII", 5, 0, 1, 0, 0, 0)
    assert read_blocks(packet, NS_PER_S) == [ReportBlock(5, 0, 1, 0, None)]


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
