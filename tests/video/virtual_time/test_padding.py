"""Padding in virtual time: told of like any packet, and nothing to the views."""

from __future__ import annotations

from contextlib import closing
from functools import cache

import pytest

from tams_app.records import PacketArrival, PacketKind
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.video.scenes import frame
from tests.video.virtual_time.runs import CLEAN, START_NS, Run, make, receivers_of

pytestmark = pytest.mark.untimed

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
