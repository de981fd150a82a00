"""What a live stream tells of its packets, with real sessions on both sides of a bad link."""

from __future__ import annotations

import math
import time

import pytest

from tams_app.records import IP_UDP_HEADER_BYTES, PacketArrival
from tams_app.units import NS_PER_S
from tams_app.video.core.pacer import FlightBound
from tams_app.video.core.packets import REPAIR_PAYLOAD_TYPE, read_rtp, transport_sequence
from tests.faults.applications import until
from tests.video.lossy_link import Keep, LossyLink
from tests.video.streams import PATIENT, UNREPAIRED, stream

pytestmark = pytest.mark.waiting

_TRANSPORT_FEEDBACK = b"\x8f\xcd"


def is_feedback(datagram: bytes) -> bool:
    return datagram[:2] == _TRANSPORT_FEEDBACK


def is_repair(datagram: bytes) -> bool:
    header = read_rtp(datagram)
    return header is not None and header.payload_type == REPAIR_PAYLOAD_TYPE


def told_of(link: LossyLink, frames: int, repaired: bool = False) -> list[PacketArrival]:
    """All that was told of `frames` frames, once nothing more comes."""
    rule = PATIENT if repaired else UNREPAIRED
    with stream(link, rule, kbps=6000.0, feedback=True) as joined:
        joined.push(range(frames))
        return joined.arrivals(lambda: len(link.rtp))


def lost_in(lost: set[int]) -> Keep:
    return lambda ordinal, datagram: ordinal not in lost


@pytest.mark.parametrize("repaired", [False, True])
def test_every_packet_is_numbered_and_told_of_with_its_size_and_fate_also_resent_ones(repaired):
    lost = {5, 17, 18, 19, *range(40, 62), 90}
    link = LossyLink(lost_in(lost))
    told = told_of(link, 40, repaired)
    assert any(map(is_repair, link.rtp)) is repaired
    assert [transport_sequence(datagram) for datagram in link.rtp] == list(range(len(link.rtp)))
    assert max(len(each) for each in link.rtp if not is_repair(each)) <= 1200
    assert len(told) > 0.9 * len(link.rtp)  # a frame without its end is told of with the next
    sizes = [len(datagram) + IP_UDP_HEADER_BYTES for datagram in link.rtp[: len(told)]]
    assert [arrival.size_bytes for arrival in told] == sizes
    fates = {place for place, arrival in enumerate(told) if arrival.arrived_ns is None}
    assert fates == {place for place in lost if place < len(told)}


@pytest.mark.parametrize("limit_bytes", [1e9, 1000.0])
def test_packets_are_sent_again_only_within_the_bound_on_what_is_under_way(limit_bytes):
    bound = FlightBound(("eih",))
    bound.set(limit_bytes, {"eih": 6000.0})
    bound.exceeded("eih", 1, 0, 0)
    link = LossyLink(lost_in({20, 30, 40, 50, 60}))
    with stream(link, PATIENT, kbps=6000.0, feedback=True, flight=bound) as joined:
        joined.push(range(30))
        if limit_bytes == 1e9:
            until(lambda: any(map(is_repair, link.rtp)), "a packet sent again")
        else:
            time.sleep(0.3)
        assert joined.sender.poll() == ""
    assert any(map(is_repair, link.rtp)) == (limit_bytes == 1e9)


def test_arrivals_are_on_the_clock_of_all_views_and_no_packet_is_older_than_the_one_before():
    link = LossyLink(lost_in(set()), delay_s=0.05)
    told = told_of(link, 20)
    transits = [each.arrived_ns - each.sent_ns for each in told if each.arrived_ns is not None]
    # one machine has one clock
    assert all(0.045 * NS_PER_S < transit_ns < 20 * NS_PER_S for transit_ns in transits)
    sent = [each.sent_ns for each in told]
    assert sent == sorted(sent)


def test_messages_that_are_lost_leave_out_their_packets_and_nothing_else():
    messages: list[int] = []

    def keep_feedback(ordinal: int, datagram: bytes) -> bool:
        if is_feedback(datagram):
            messages.append(ordinal)
            return len(messages) not in (5, 6, 12)
        return True

    link = LossyLink(lost_in(set()), keep_feedback=keep_feedback)
    told = told_of(link, 40)
    assert 0.7 * len(link.rtp) < len(told) < len(link.rtp)
    assert all(each.arrived_ns is not None for each in told)
    assert len({(each.sent_ns, each.size_bytes) for each in told}) > 30


def test_when_feedback_is_cut_arrivals_stop_and_the_stream_goes_on():
    cut = False
    link = LossyLink(lost_in(set()), keep_feedback=lambda ordinal, datagram: not cut)
    with stream(link, UNREPAIRED, feedback=True) as joined:
        joined.push(range(20))
        assert joined.wait_until(lambda: len(joined.shown) >= 15)
        until(lambda: joined.received.newest_sent_ns > 0, "feedback")
        cut = True
        assert joined.arrivals(lambda: math.inf)  # also what was under way
        joined.push(range(20, 60))  # raises if either end has failed
        assert joined.received.take_arrivals() == []
        cut = False
        joined.push(range(60, 80))
        assert len(joined.arrivals(lambda: 15)) >= 15


def test_receivers_report_losses_and_the_round_trip_without_any_change_of_the_packets():
    link = LossyLink(lambda ordinal, datagram: ordinal % 10 != 3, delay_s=0.02)
    with stream(link, UNREPAIRED, kbps=4000.0) as joined:
        reception, first = None, 0
        # the first is of few packets, and may come before a report of the sender
        while reception is None or not (reception.fraction_lost and reception.round_trip_ns):
            assert first < 1200, "no report of a loss"
            joined.push(range(first, first := first + 20))
            reception = joined.received.take_reception() or reception
        assert joined.received.take_arrivals() == []
    assert reception.fraction_lost < 0.5
    assert 0.035 * NS_PER_S < reception.round_trip_ns < 2 * NS_PER_S
    assert not any(datagram[0] & 0x10 for datagram in link.rtp)  # no extension
    assert not any(map(is_feedback, link.feedback))
