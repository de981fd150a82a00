"""What an `Uplink` asks of senders in virtual time: frames left out, packets paced, padding."""

from __future__ import annotations

from contextlib import closing
from functools import cache
from itertools import groupby

import pytest

from tams_app.config import Network
from tams_app.records import IP_UDP_HEADER_BYTES, PacketArrival, PacketKind, PacketRecord
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.pacer import FlightBound, Pacer
from tests.video.scenes import frame
from tests.video.virtual_time.runs import CLEAN, START_NS, Run, drive, make, receivers_of

pytestmark = pytest.mark.untimed

GAP = range(45, 60)
LOSSY = Network(latency_ms=20, jitter_ms=4, loss=0.03)


def test_what_is_left_out_is_neither_encoded_nor_made_up_for() -> None:
    run = Run()
    with closing(make(run, CLEAN)) as video:
        for index in range(90):
            video.advance_to(START_NS + index * NS_PER_S // 30)
            video.push(frame(index, capture_ns=video.now_ns), index in GAP)
        video.advance_to(video.now_ns + NS_PER_S)
    assert [(one.index, one.under_way) for one in run.dropped] == [(index, True) for index in GAP]
    sizes = {one.index: len(one.data) for one in run.encoded}
    assert sizes.keys() == set(range(90)) - set(GAP)
    before = sum(sizes[index] for index in range(30, 45)) / 15
    after = [sizes[index] for index in range(60, 75)]
    # the image has moved on by half a second: the frame needs the bits, and may not have them
    assert max(after) < 1.6 * before
    assert sum(after) / 15 == pytest.approx(before, rel=0.1)


@pytest.mark.parametrize(("limit_bytes", "resent"), [(1e9, True), (1000.0, False)])
def test_packets_are_sent_again_only_within_the_bound(limit_bytes: float, resent: bool) -> None:
    run, bound = Run(), FlightBound(("eih",))
    bound.set(limit_bytes, {"eih": 900.0})
    bound.exceeded("eih", START_NS, 0, 0)
    with closing(make(run, LOSSY, feedback=True, flight=bound)) as video:
        drive(video, ("eih",), range(60))
    assert run.nacks > 3
    assert any(one.kind is PacketKind.REPAIR for one in run.packets) == resent


# --- paced packets: when they enter the link -----------------------------------------------------

PACE_KBPS = 1.5 * 2000.0


@cache
def paced_run(paced: bool) -> Run:
    found = Run()
    pacer = Pacer(PACE_KBPS / 1.5) if paced else None
    with closing(make(found, CLEAN, kbps=1500.0, pacer=pacer)) as video:
        drive(video, ("eih",), range(20))
    return found


def frames_of(run: Run) -> list[list[PacketRecord]]:
    media = [one for one in run.packets if one.kind is PacketKind.MEDIA]
    return [list(ours) for _, ours in groupby(media, key=lambda one: one.rtp_timestamp)]


def test_a_frame_enters_over_its_time_at_the_pace_instead_of_at_once() -> None:
    for packets in frames_of(paced_run(paced=False)):
        assert len({packet.entered_ns for packet in packets}) == 1
    spread = [packets for packets in frames_of(paced_run(paced=True)) if len(packets) > 3]
    assert spread
    for packets in spread:
        before_last = sum(packet.size_bytes for packet in packets[:-1])
        took_ns = packets[-1].entered_ns - packets[0].entered_ns
        assert took_ns == pytest.approx(before_last * 8e6 / PACE_KBPS, abs=5 * NS_PER_MS)


def test_paced_or_not_the_same_is_sent_and_shown() -> None:
    at_once, paced = paced_run(paced=False), paced_run(paced=True)
    assert [one.index for one in paced.shown] == [one.index for one in at_once.shown]
    assert [one.data for one in paced.encoded] == [one.data for one in at_once.encoded]
    sizes = [[packet.size_bytes for packet in one] for one in frames_of(paced)]
    assert sizes == [[packet.size_bytes for packet in one] for one in frames_of(at_once)]
    assert min(map(min, sizes)) > IP_UDP_HEADER_BYTES


# --- padding: reported like any packet, and nothing to the views ---------------------------------

VIEWS, FRAMES, TRAIN_BYTES = ("eih", "gt"), 45, 2000


class Padded(Run):
    """A run with a train of padding behind each frame, and what was told of it."""

    def __init__(self, train_bytes: int, feedback: bool = True) -> None:
        super().__init__()
        heard = receivers_of(VIEWS)
        with closing(make(self, CLEAN, VIEWS, feedback=feedback, received=heard)) as video:
            video.pad(train_bytes)
            for index in range(FRAMES):
                video.advance_to(START_NS + index * NS_PER_S // 30)
                for view in VIEWS:
                    video.push(frame(index, view, video.now_ns))
                video.advance_to(video.now_ns + 20 * NS_PER_MS)
                video.pad(train_bytes)
            video.advance_to(video.now_ns + NS_PER_S)
            self.wire_bytes = video.wire_bytes()
        self.told: list[PacketArrival] = heard["eih"].take_arrivals()

    @property
    def padding_bytes(self) -> int:
        return sum(one.size_bytes for one in self.packets if one.kind is PacketKind.PADDING)


@cache
def padded(train_bytes: int) -> Padded:
    return Padded(train_bytes)


def test_what_is_padded_takes_nothing_from_the_views() -> None:
    with_padding, without = padded(TRAIN_BYTES), padded(0)
    assert [one.data for one in with_padding.encoded] == [one.data for one in without.encoded]
    assert [one.index for one in with_padding.shown] == [one.index for one in without.shown]
    assert with_padding.padding_bytes == FRAMES * TRAIN_BYTES
    assert with_padding.wire_bytes - without.wire_bytes == FRAMES * TRAIN_BYTES


def test_it_is_told_of_in_the_order_of_sending_with_the_first_view_s_packets() -> None:
    run = padded(TRAIN_BYTES)
    sent = [
        (one.entered_ns, one.size_bytes)
        for one in run.packets
        if one.view == "eih" and one.kind is not PacketKind.RTCP
    ]
    assert [(one.sent_ns, one.size_bytes) for one in run.told] == sent
    assert all(one.arrived_ns is not None for one in run.told)
    assert not any(one.kind is PacketKind.PADDING and one.view != "eih" for one in run.packets)


def test_without_feedback_on_each_packet_there_is_none() -> None:
    assert Padded(TRAIN_BYTES, feedback=False).padding_bytes == 0
