"""Frames that the bound on data in flight leaves out, and resends that it refuses."""

from __future__ import annotations

from contextlib import closing

import pytest

from tams_app.config import Network
from tams_app.records import PacketKind
from tams_app.units import NS_PER_S
from tams_app.video.core.flight import FlightBound
from tests.video.scenes import frame
from tests.video.virtual_time.runs import CLEAN, START_NS, Run, drive, make

pytestmark = pytest.mark.untimed

FRAMES = 90
GAP = range(45, 60)
LOSSY = Network(latency_ms=20, jitter_ms=4, loss=0.03)


def test_what_is_left_out_is_neither_encoded_nor_made_up_for() -> None:
    run = Run()
    with closing(make(run, CLEAN)) as video:
        for index in range(FRAMES):
            video.advance_to(START_NS + index * NS_PER_S // 30)
            video.push(frame(index, capture_ns=video.now_ns), index in GAP)
        video.advance_to(video.now_ns + NS_PER_S)
    assert [(one.index, one.under_way) for one in run.dropped] == [(index, True) for index in GAP]
    sizes = {one.index: len(one.data) for one in run.encoded}
    assert sizes.keys() == set(range(FRAMES)) - set(GAP)
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
    with closing(make(run, LOSSY, feedback=True, may_resend=bound.admits_resend)) as video:
        drive(video, ("eih",), range(60))
    assert run.nacks > 3
    assert any(one.kind is PacketKind.REPAIR for one in run.packets) == resent
