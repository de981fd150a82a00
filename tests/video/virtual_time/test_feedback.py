"""What receivers tell in virtual time: of each packet, in a message for each frame."""

from __future__ import annotations

from contextlib import closing
from functools import cache
from itertools import pairwise

import pytest

from tams_app.config import Network
from tams_app.records import PacketArrival, PacketFate, PacketKind, PacketRecord, Reception
from tams_app.units import NS_PER_MS
from tams_app.video.core.rtcp import ARRIVAL_TICK_NS, uplink_report
from tests.video.streams import jitter_counts
from tests.video.virtual_time.runs import NETWORKS, Run, drive, make, receivers_of, run_whole

pytestmark = pytest.mark.untimed

VIEWS = ("eih", "gt")
LOSSY = Network(latency_ms=20, jitter_ms=4, loss=0.03, rate_kbps=4000)


class Told(Run):
    """A run, and what the senders heard in it."""

    def __init__(self, network: Network, frames: int, feedback: bool, groups: int = 0) -> None:
        super().__init__()
        heard = receivers_of(VIEWS)
        video = make(self, network, VIEWS, groups=groups, feedback=feedback, received=heard)
        with closing(video):
            drive(video, VIEWS, range(frames))
            report = uplink_report(video.now_ns, video.wire_bytes(), tuple(heard.values()))
            self.jitter = {view: jitter_counts(video.receivers[view].decoder) for view in VIEWS}
        self.arrivals: tuple[PacketArrival, ...] = report.arrivals
        self.receptions: tuple[Reception, ...] = report.receptions

    def of(self, view: str) -> list[tuple[PacketArrival, PacketRecord]]:
        told = [arrival for arrival in self.arrivals if arrival.view == view]
        sent = [
            packet
            for packet in self.packets
            if packet.view == view and packet.kind is not PacketKind.RTCP
        ]
        return list(zip(told, sent, strict=False))


@cache
def told(feedback: bool = True, groups: int = 0) -> Told:
    return Told(LOSSY, 60, feedback, groups)


@pytest.mark.parametrize("groups", [0, 2])
def test_every_packet_is_told_of_once_to_a_quarter_of_a_millisecond_whatever_its_kind(
    groups: int,
) -> None:
    run = told(groups=groups)
    rtp = [packet for packet in run.packets if packet.kind is not PacketKind.RTCP]
    assert any(packet.kind is PacketKind.REPAIR for packet in rtp)
    assert any(packet.kind is PacketKind.PARITY for packet in rtp) == bool(groups)
    assert len(rtp) * 0.95 < len(run.arrivals) <= len(rtp)
    assert all(before.sent_ns <= after.sent_ns for before, after in pairwise(run.arrivals))
    for view in VIEWS:
        for arrival, packet in run.of(view):
            assert (arrival.sent_ns, arrival.size_bytes) == (packet.entered_ns, packet.size_bytes)
            assert (arrival.arrived_ns is None) == (packet.fate is PacketFate.LOST)
            if arrival.arrived_ns is not None:
                assert arrival.arrived_ns % ARRIVAL_TICK_NS == 0
                assert 0 <= packet.delivered_ns - arrival.arrived_ns < ARRIVAL_TICK_NS


def test_a_frame_is_told_of_within_a_report_interval_of_its_end_and_crosses_the_link_back() -> None:
    run = told()
    delivered = {
        (packet.view, packet.delivered_ns // ARRIVAL_TICK_NS * ARRIVAL_TICK_NS): packet.delivered_ns
        for packet in run.packets
    }
    waits_ms = []
    for view, feedback, comes_back_ns in run.feedback:
        for message in feedback.arrivals:
            ended_ns = delivered[view, message.arrived_ns[message.last]]
            waits_ms.append((feedback.sent_ns - ended_ns) / NS_PER_MS)
            assert comes_back_ns - feedback.sent_ns >= 16 * NS_PER_MS
    assert len(waits_ms) >= 110
    assert max(waits_ms) <= 31


@pytest.mark.verify
def test_listening_to_reports_alone_changes_no_bit_of_a_run() -> None:
    listened = told(feedback=False)
    assert listened.digest() == run_whole(LOSSY, 60, VIEWS).digest()
    assert listened.arrivals == ()


def test_receptions_have_losses_and_the_round_trip() -> None:
    by_view = {reception.view: reception for reception in told(feedback=False).receptions}
    assert set(by_view) == set(VIEWS)
    for view, reception in by_view.items():
        sent = [one for one in told(False).packets if one.view == view]
        media = [one for one in sent if one.kind is PacketKind.MEDIA]
        lost = sum(one.fate is not PacketFate.DELIVERED for one in media)
        assert reception.fraction_lost == pytest.approx(lost / len(media), abs=0.02)
        assert 35 * NS_PER_MS < reception.round_trip_ns < 80 * NS_PER_MS


def test_the_same_seed_tells_the_same() -> None:
    one, other = (Told(NETWORKS["s3"], 20, True) for _ in range(2))
    assert (one.digest(), one.arrivals, one.receptions) == (
        other.digest(),
        other.arrivals,
        other.receptions,
    )
