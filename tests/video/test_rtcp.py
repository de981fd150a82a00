"""What is read from a receiver's RTCP."""

from __future__ import annotations

import struct
from itertools import pairwise

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.packets import SEQUENCES
from tams_app.video.core.rtcp import ARRIVAL_TICK_NS, ReportBlock, read_arrivals, read_blocks

pytestmark = pytest.mark.untimed

UNIX_NTP_S = 2_208_988_800
# Written by GStreamer 1.22 with packets 25 to 41 of 22 to 59 lost, 2 ms from packet to packet.
WITH_A_LONG_GAP = bytes.fromhex(
    "8fcd000ce343c3615441000000160026000000022003001180"
    "0087ffbf80ce09099d090909080909090809090909080909090900"
)


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
