"""Parity in virtual time: what is lost comes back at once, and the target pays for it."""

from __future__ import annotations

from functools import cache

import pytest

from tams_app.config import Network, RepairConfig
from tams_app.records import PacketKind
from tams_app.units import NS_PER_S
from tams_app.video.core.concealment import restored_packets
from tams_app.video.core.repair import repair_rule
from tests.video.virtual_time.runs import Run, run_whole

pytestmark = pytest.mark.untimed

LOSSY = Network(latency_ms=80, jitter_ms=5, loss=0.02, rate_kbps=3000)
RULE = repair_rule(LOSSY, 300.0, RepairConfig(mode="adaptive"))
FRAMES, KBPS = 150, 900.0


@cache
def protected(groups: int) -> Run:
    return run_whole(LOSSY, FRAMES, kbps=KBPS, rule=RULE, groups=groups)


def lost(run: Run) -> int:
    return sum(one.kind is PacketKind.MEDIA and not one.delivered_ns for one in run.packets)


def damaged(run: Run) -> set[int]:
    return {one.index for one in run.shown} - run.exact


def test_frames_that_lost_one_packet_of_a_group_are_whole_without_a_request() -> None:
    run = protected(1)
    assert lost(run) >= 3
    assert run.nacks == 0
    assert run.jitter["eih"]["num-lost"] == lost(run) - len(restored_packets(run.packets)) == 0
    assert [one.index for one in run.shown] == list(range(FRAMES))
    assert damaged(run) == set()


def test_a_restored_frame_waits_for_its_parity_and_for_no_round_trip() -> None:
    run = protected(1)
    ages_ns = [one.shown_ns - one.capture_ns for one in run.shown]
    assert max(ages_ns) < 2 * 80e6


def test_what_the_log_says_to_be_concealed_is_what_was_damaged() -> None:
    unprotected = protected(0)
    for run in (protected(1), unprotected):
        assert damaged(run) <= run.concealed
    assert damaged(unprotected)


@pytest.mark.parametrize("groups", [1, 2])
def test_parity_is_paid_for_by_the_target(groups: int) -> None:
    run = protected(groups)
    settled = [one for one in run.packets if one.kind is not PacketKind.RTCP][200:]
    seconds = (settled[-1].entered_ns - settled[0].entered_ns) / NS_PER_S
    kbps = sum(one.size_bytes for one in settled) * 8 / 1000 / seconds
    assert kbps == pytest.approx(KBPS, rel=0.03)
    parity = [one for one in settled if one.kind is PacketKind.PARITY]
    assert len(parity) >= groups * len({one.rtp_timestamp for one in settled}) - 3
