"""The views in virtual time: exact, repeatable, and with the repair that live runs have."""

from __future__ import annotations

import subprocess
import sys
from contextlib import closing
from itertools import pairwise
from pathlib import Path

import pytest

from tams_app.config import Network, RepairConfig
from tams_app.records import PacketFate, PacketKind
from tams_app.runtime.process import PROJECT_DIRECTORY
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.repair import RepairRule, repair_rule
from tams_app.video.virtual.shared import DECODING_NS, ENCODING_NS
from tests.video.scenes import frame
from tests.video.streams import PATIENT, UNREPAIRED, checksum, jitter_counts
from tests.video.virtual_time.runs import (
    CLEAN,
    NETWORKS,
    START_NS,
    Run,
    drive,
    make,
    run_whole,
    shared_run,
)

pytestmark = pytest.mark.untimed


def digest_of_a_fresh_process(network: str) -> str:
    command = [sys.executable, "-m", "tests.video.virtual_time.runs", network, "1", "2"]
    done = subprocess.run(
        command, cwd=PROJECT_DIRECTORY, capture_output=True, text=True, check=True, timeout=100
    )
    return done.stdout


@pytest.mark.verify
def test_two_fresh_processes_agree_to_the_last_bit_also_beside_a_busy_one() -> None:
    alone = digest_of_a_fresh_process("s3")
    busy = [
        subprocess.Popen(["nice", "-n", "15", sys.executable, "-c", "while True: pass"])
        for _ in range(2)
    ]
    try:
        beside = digest_of_a_fresh_process("s3")
    finally:
        for each in busy:
            each.kill()
            each.wait()
    assert alone == beside
    assert int(alone.split()[1]) > 130  # three views for two seconds


def test_another_seed_is_another_run() -> None:
    one, other = (run_whole(NETWORKS["lossy"], 6, seed=seed) for seed in (1, 2))
    assert one.digest() != other.digest()


def test_a_frame_is_shown_after_encoding_link_and_decoding() -> None:
    run = shared_run("clean", 60)
    assert {sent.encoded_ns - sent.capture_ns for sent in run.encoded} == {ENCODING_NS}
    assert {sent.pushed_ns - sent.capture_ns for sent in run.encoded} == {0}
    captured = {sent.index: sent.capture_ns for sent in run.encoded}
    ages = {seen.index: seen.shown_ns - captured[seen.index] for seen in run.shown}
    # the jitter buffer holds the very first packet for its whole latency
    way_ns = ENCODING_NS + 20 * NS_PER_MS + DECODING_NS
    assert {age for index, age in ages.items() if index >= 5} == {way_ns}


def test_the_screen_changes_at_its_time_and_not_before() -> None:
    run, last = Run(), 9
    with closing(make(run, CLEAN)) as video:
        drive(video, ("eih",), range(last + 1), after_ns=0)
        due_ns = video.now_ns + ENCODING_NS + 20 * NS_PER_MS + DECODING_NS
        video.advance_to(due_ns - 1)
        before = run.shown[-1]
        video.advance_to(due_ns)
        after = run.shown[-1]
    assert (before.index, after.index, after.shown_ns) == (last - 1, last, due_ns)


def test_how_finely_time_is_advanced_changes_nothing() -> None:
    digests = set()
    for steps in (1, 4, 7):
        run = Run()
        with closing(make(run, NETWORKS["lossy"], rule=UNREPAIRED)) as video:
            for index in range(20):
                video.push(frame(index, capture_ns=video.now_ns))
                begin_ns = video.now_ns
                due_ns = START_NS + (index + 1) * NS_PER_S // 30
                for step in range(1, steps + 1):
                    video.advance_to(begin_ns + (due_ns - begin_ns) * step // steps)
        digests.add(run.digest())
    assert len(digests) == 1


def test_lost_packets_are_sent_again_a_round_trip_later_and_the_frames_stay_whole() -> None:
    run = shared_run("lossy", 90, PATIENT)
    lost = [
        packet
        for packet in run.packets
        if packet.kind is PacketKind.MEDIA and packet.fate is PacketFate.LOST
    ]
    repairs = [packet for packet in run.packets if packet.kind is PacketKind.REPAIR]
    assert lost
    assert {packet.sequence for packet in lost} <= {packet.sequence for packet in repairs}
    assert run.nacks >= len(lost)
    assert run.jitter["eih"]["num-lost"] == 0
    assert run.jitter["eih"]["rtx-success-count"] >= len(lost)
    assert {seen.index: checksum(seen) for seen in run.shown} == run.references
    media = {packet.sequence: packet for packet in run.packets if packet.kind is PacketKind.MEDIA}
    for repair in repairs:
        original = media[repair.sequence]
        assert repair.size_bytes == original.size_bytes + 2
        assert repair.rtp_timestamp == original.rtp_timestamp
        # the packet behind it must arrive, and the request must come back
        assert repair.entered_ns - original.entered_ns > 2 * 16 * NS_PER_MS


def test_repair_counts_against_the_target() -> None:
    run = run_whole(Network(latency_ms=10, loss=0.15), 90, rule=PATIENT)
    sent = sum(packet.size_bytes for packet in run.packets if packet.kind is not PacketKind.RTCP)
    repair = sum(packet.size_bytes for packet in run.packets if packet.kind is PacketKind.REPAIR)
    assert repair > 0.12 * sent
    assert run.wire_bytes == sent
    assert sent * 8 / 3 / 1000 == pytest.approx(900, rel=0.08)


def test_an_unrepaired_loss_brings_a_keyframe_and_a_whole_frame() -> None:
    run = shared_run("lossy", 90, UNREPAIRED)
    keyframes = [sent.index for sent in run.encoded if sent.keyframe]
    assert run.jitter["eih"]["num-lost"] > 0
    assert run.nacks == 0
    assert all(packet.kind is not PacketKind.REPAIR for packet in run.packets)
    assert 1 < len(keyframes) <= 1 + run.plis
    assert all(later - earlier >= 9 for earlier, later in pairwise(keyframes[1:]))  # 300 ms
    assert any(index in run.exact for index in keyframes[1:])


def test_no_report_enters_the_link_before_the_first_frame() -> None:
    run = run_whole(NETWORKS["s2"], 3, ("eih", "gt"))
    kinds = [packet.kind for packet in run.packets]
    media = [packet for packet in run.packets if packet.kind is PacketKind.MEDIA]
    of_first_frame = [packet for packet in media if packet.rtp_timestamp == 0]
    assert {packet.view for packet in of_first_frame} == {"eih", "gt"}
    assert kinds.index(PacketKind.RTCP) >= len(of_first_frame) > 2


def test_three_views_share_one_bottleneck() -> None:
    views = ("eih", "gt", "gs")
    run = run_whole(NETWORKS["s3"], 30, views, kbps=2000.0, rule=UNREPAIRED)
    assert any(packet.fate is PacketFate.OVERFLOW for packet in run.packets)
    departures = [packet.departed_ns for packet in run.packets if packet.departed_ns]
    assert departures == sorted(departures)
    assert {seen.view for seen in run.shown} == set(views)


def test_time_does_not_go_back_and_a_run_can_be_closed_twice() -> None:
    video = make(Run(), CLEAN)
    video.push(frame(0, capture_ns=START_NS))
    video.advance_to(START_NS + 10)
    with pytest.raises(ValueError, match="does not go back"):
        video.advance_to(START_NS + 9)
    video.close()
    video.close()


def test_a_receiver_that_waited_for_its_sender_still_waits_for_repair() -> None:
    # with mode=none the jitter buffer's clock runs from the receiver's start
    run, begin_ns = Run(), START_NS + NS_PER_S  # longer than the jitter buffer's latency
    with closing(make(run, NETWORKS["far"], rule=PATIENT)) as video:
        drive(video, ("eih",), range(40), begin_ns)
        counts = jitter_counts(video.receivers["eih"].decoder)
    assert counts["rtx-success-count"] > 0
    assert counts["num-lost"] == 0


def test_a_link_that_was_down_for_seconds_leaves_identity_and_repair_right(tmp_path: Path) -> None:
    # after 3 s without packets the jitter buffer restarts its PTS from 0
    trace = tmp_path / "down.csv"
    trace.write_text("t_ms,kbps\n0,5000\n400,0\n3800,5000\n60000,5000\n")
    network = Network(latency_ms=20, loss=0.02, trace=str(trace), queue_ms=1, queue_min_bytes=6000)
    run = run_whole(network, 160, rule=RepairRule(True, 1000, 300.0))
    after = [seen for seen in run.shown if 125 <= seen.index < 155]
    assert max(seen.index for seen in run.shown if seen.index < 100) < 20
    assert [seen.index for seen in after] == list(range(125, 155))
    assert [checksum(seen) for seen in after] == [run.references[seen.index] for seen in after]
    repaired = {packet.sequence for packet in run.packets if packet.kind is PacketKind.REPAIR}
    lost_late = [
        packet
        for packet in run.packets
        if packet.fate is PacketFate.LOST and 125 * 3000 <= packet.rtp_timestamp < 155 * 3000
    ]
    assert lost_late
    assert {packet.sequence for packet in lost_late} <= repaired


# --- what `video.repair` switches off is not done, and what it forces is --------------------------


def far_run(wanted: RepairConfig) -> Run:
    return run_whole(NETWORKS["far"], 50, rule=repair_rule(NETWORKS["far"], 300.0, wanted))


def test_without_pli_no_keyframe_is_asked_for() -> None:
    found = far_run(RepairConfig(mode="paper", rtx="off", pli=False))
    assert found.jitter["eih"]["num-lost"] > 0
    assert found.plis == 0
    assert [one.index for one in found.encoded if one.keyframe] == [0]


def test_rtx_resends_where_it_is_forced_though_the_network_is_slow() -> None:
    packets = far_run(RepairConfig(mode="paper", rtx="on")).packets
    assert any(packet.kind is PacketKind.REPAIR for packet in packets)
