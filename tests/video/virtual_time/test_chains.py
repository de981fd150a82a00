"""The real chains between pads of our own."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing

import pytest

from tams_app import gst
from tams_app.config import VideoConfig
from tams_app.records import EncodedFrame, ShownFrame
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.frame_identity import SentFrame
from tams_app.video.core.packets import read_rtp
from tams_app.video.core.repair import RepairRule
from tams_app.video.core.sender import Sender, StreamSettings, Uplink
from tams_app.video.virtual.receiver import DecoderChain, time_left_ms
from tams_app.video.virtual.sender import EncoderChain
from tams_app.video.virtual.stepped_clock import SteppedClock
from tams_app.video.virtual.wait_idle import IdleWaiter
from tests.video.scenes import frame
from tests.video.streams import PATIENT, UNREPAIRED

pytestmark = pytest.mark.untimed

FRAME_NS = NS_PER_S // 30


class Ends:
    """An encoder and a decoder with nothing in between but the test."""

    def __init__(self, rule: RepairRule = PATIENT) -> None:
        config = VideoConfig(views=("eih",))
        self.clock = SteppedClock(NS_PER_S)
        self.encoded: list[EncodedFrame] = []
        self.shown: list[ShownFrame] = []
        stream = StreamSettings("eih", config, rule.rtx, 1500.0, 80.0)
        self.sender, self.identified = Sender(stream, Uplink()), True
        self.encoder = EncoderChain(self.sender, self.clock)
        self.decoder = DecoderChain("eih", config, rule, self.identify, self.clock)
        self.waiter = IdleWaiter()

    def identify(self, timestamp: int) -> SentFrame | None:
        return self.sender.sent.find(timestamp) if self.identified else None

    def packets(self, index: int) -> list[bytes]:
        captured = frame(index, capture_ns=self.clock.now_ns())
        admitted = self.sender.admit(captured, 0, self.clock.now_ns())
        encoded, packets = self.encoder.encode(captured, admitted)
        self.encoded += encoded
        return packets

    def feed(self, packet: bytes, resent: bool = False) -> None:
        self.decoder.feed(packet, resent)
        self._wait()

    def let_pass(self, duration_ns: int) -> None:
        end_ns = self.clock.now_ns() + duration_ns
        while (due_ns := self.clock.next_ns()) is not None and due_ns <= end_ns:
            self.clock.move_to(max(due_ns, self.clock.now_ns()))
            self.clock.end_next_wait()
            self._wait()
        self.clock.move_to(end_ns)

    def carry(self, indices: range) -> None:
        for index in indices:
            for packet in self.packets(index):
                self.feed(packet)
            self.let_pass(FRAME_NS)

    def _wait(self) -> None:
        self.waiter.wait()
        self.shown += self.decoder.take_shown()

    def close(self) -> None:
        self.encoder.close()
        self.decoder.close()
        self.waiter.close()


@pytest.fixture
def ends() -> Iterator[Ends]:
    with closing(Ends()) as made:
        yield made


def test_a_requested_keyframe_is_the_next_frame(ends: Ends) -> None:
    ends.packets(0)
    ends.packets(1)
    ends.encoder.request_keyframe()
    ends.packets(2)
    ends.packets(3)
    assert [sent.keyframe for sent in ends.encoded] == [True, False, True, False]


def test_a_frame_that_nobody_can_identify_is_not_shown(ends: Ends) -> None:
    ends.carry(range(16))
    ends.identified = False
    ends.carry(range(16, 20))
    assert [seen.index for seen in ends.shown] == list(range(16))


def test_a_missing_packet_is_asked_for_at_once_and_once(ends: Ends) -> None:
    ends.carry(range(16))
    first, _, *others = ends.packets(16)
    ends.feed(first)
    assert ends.decoder.take_nacks() == []
    for packet in others:
        ends.feed(packet)
    ((sequence, patience_ms),) = ends.decoder.take_nacks()
    header = read_rtp(first)
    assert sequence == header.sequence + 1
    assert 200 <= patience_ms <= PATIENT.latency_ms
    assert ends.decoder.take_nacks() == []


@pytest.mark.parametrize(
    ("deadline", "delay", "round_trip", "left"),
    [(400, 10, 80, 310), (400, 0, 0, 400), (100, 0, 200, 0), (100, 120, 40, 60)],
)
def test_the_time_left_to_ask_is_reckoned_as_rtpsession_does(
    deadline: int, delay: int, round_trip: int, left: int
) -> None:
    text = (
        f"GstRTPRetransmissionRequest,deadline=(uint){deadline},delay=(uint){delay},"
        f"avg-rtt=(uint){round_trip};"
    )
    structure, _ = gst.load().Gst.Structure.from_string(text)
    assert time_left_ms(structure) == left


def test_a_packet_that_stays_away_is_given_up_after_the_latency_and_a_keyframe_asked_for() -> None:
    with closing(Ends(UNREPAIRED)) as ends:
        ends.carry(range(16))
        first, _, *others = ends.packets(16)
        for packet in (first, *others):
            ends.feed(packet)
        ends.let_pass((UNREPAIRED.latency_ms - 1) * NS_PER_MS)
        assert not ends.decoder.take_pli()
        ends.let_pass(NS_PER_S // 30)
        ends.carry(range(17, 19))
        assert ends.decoder.take_pli()
        assert not ends.decoder.take_pli()
        assert ends.decoder.take_nacks() == []


def whole(ends: Ends) -> list[bool]:
    return [seen.whole for seen in ends.shown]


def test_no_frame_predicted_from_lost_ones_is_whole_until_a_complete_keyframe() -> None:
    with closing(Ends(UNREPAIRED)) as ends:
        ends.carry(range(16))
        assert whole(ends) == [True] * 16
        for index in range(16, 26):
            ends.packets(index)  # lost, all of them
            ends.let_pass(FRAME_NS)
        ends.carry(range(26, 60))
        assert len(ends.shown) > 16 + 20, "most of them are shown"
        assert not any(whole(ends)[16:])
        ends.encoder.request_keyframe()
        first, _, *others = ends.packets(60)  # a keyframe with a hole
        for packet in (first, *others):
            ends.feed(packet)
        ends.let_pass(FRAME_NS)
        ends.carry(range(61, 65))
        assert not any(whole(ends)[16:])
        ends.encoder.request_keyframe()
        ends.carry(range(65, 70))
        assert [seen.index for seen in ends.shown if seen.whole][16:] == list(range(65, 70))


@pytest.mark.parametrize("lost", [0, 1, -1], ids=["first", "second", "last"])
def test_one_lost_packet_breaks_the_chain_and_one_that_is_resent_does_not(lost: int) -> None:
    for rule in (UNREPAIRED, PATIENT):
        with closing(Ends(rule)) as ends:
            ends.carry(range(16))
            packets = ends.packets(16)
            missing = packets.pop(lost)
            for packet in packets:
                ends.feed(packet)
            ends.let_pass(FRAME_NS)
            (first, *others) = ends.packets(17)  # with it the loss of a last packet shows
            ends.feed(first)
            if rule.rtx:
                ends.feed(missing, resent=True)
            for packet in others:
                ends.feed(packet)
            ends.let_pass(FRAME_NS)
            ends.carry(range(18, 40))
            assert ends.shown[-1].index == 39
            whole_ones = [seen.index for seen in ends.shown if seen.whole]
            assert whole_ones == list(range(40 if rule.rtx else 16))


@pytest.mark.parametrize("past", [0, 20], ids=["all", "all but a few"])
def test_a_loss_of_all_sequence_numbers_there_are_breaks_the_chain(past: int) -> None:
    with closing(Ends(UNREPAIRED)) as ends:
        ends.carry(range(16))
        ends.let_pass(250 * NS_PER_S)  # so long 65,536 packets take
        for index in range(16, 50):  # the first of them look like late ones
            for packet in ends.packets(index):
                number = (int.from_bytes(packet[2:4]) - past) % 65536
                ends.feed(packet[:2] + number.to_bytes(2) + packet[4:])
            ends.let_pass(FRAME_NS)
        assert ends.shown[-1].index == 49
        assert not any(whole(ends)[16:])
        assert ends.decoder.take_pli()


def test_a_keyframe_is_asked_for_again_and_again_until_a_complete_one_has_come() -> None:
    with closing(Ends(UNREPAIRED)) as ends:
        ends.carry(range(16))
        ends.packets(16)
        asked = 0
        for index in range(17, 77):  # two seconds, in which no request gets through
            ends.carry(range(index, index + 1))
            asked += ends.decoder.take_pli()
        assert asked == 4, "at once, and whenever two intervals of 300 ms are over"
        ends.encoder.request_keyframe()
        ends.carry(range(77, 97))
        assert ends.shown[-1].whole
        assert not ends.decoder.take_pli()
