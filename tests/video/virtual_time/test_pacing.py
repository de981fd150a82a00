"""Paced packets in virtual time: when they enter the link, and that nothing else is different."""

from __future__ import annotations

from contextlib import closing
from functools import cache
from itertools import groupby

import pytest

from tams_app.records import IP_UDP_HEADER_BYTES, PacketKind, PacketRecord
from tams_app.units import NS_PER_MS
from tams_app.video.core.pacer import Pacer
from tests.video.virtual_time.runs import CLEAN, Run, drive, make

pytestmark = pytest.mark.untimed

FRAMES, PACE_KBPS = 20, 1.5 * 2000.0


@cache
def run(paced: bool) -> Run:
    found = Run()
    pacer = Pacer(PACE_KBPS / 1.5) if paced else None
    with closing(make(found, CLEAN, kbps=1500.0, pacer=pacer)) as video:
        drive(video, ("eih",), range(FRAMES))
    return found


def frames_of(run: Run) -> list[list[PacketRecord]]:
    media = [one for one in run.packets if one.kind is PacketKind.MEDIA]
    return [list(ours) for _, ours in groupby(media, key=lambda one: one.rtp_timestamp)]


def test_a_frame_enters_over_its_time_at_the_pace_instead_of_at_once() -> None:
    for frame in frames_of(run(paced=False)):
        assert len({packet.entered_ns for packet in frame}) == 1
    spread = [frame for frame in frames_of(run(paced=True)) if len(frame) > 3]
    assert spread
    for frame in spread:
        before_last = sum(packet.size_bytes for packet in frame[:-1])
        took_ns = frame[-1].entered_ns - frame[0].entered_ns
        assert took_ns == pytest.approx(before_last * 8e6 / PACE_KBPS, abs=5 * NS_PER_MS)


def test_the_same_is_sent_and_shown() -> None:
    at_once, paced = run(paced=False), run(paced=True)
    assert [one.index for one in paced.shown] == [one.index for one in at_once.shown]
    assert [one.data for one in paced.encoded] == [one.data for one in at_once.encoded]
    sizes = [[packet.size_bytes for packet in frame] for frame in frames_of(paced)]
    assert sizes == [[packet.size_bytes for packet in frame] for frame in frames_of(at_once)]
    assert min(map(min, sizes)) > IP_UDP_HEADER_BYTES
