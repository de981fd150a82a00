"""Whole trials in virtual time, cut short: what they leave behind, and that they repeat."""

from __future__ import annotations

import subprocess
import sys
from itertools import pairwise

import numpy as np
import pytest

from tams_app.config import load_config
from tams_app.errors import ConfigError, LogError
from tams_app.recording import LOG_NAME, SessionLog, read_log, read_video
from tams_app.records import PacketFate, PacketKind, Phase
from tams_app.runtime.process import PROJECT_DIRECTORY
from tams_app.session.virtual import trial as trial_module
from tams_app.session.virtual.side import DELIVERY_NS
from tams_app.session.virtual.trial import START_NS, VirtualTrial
from tams_app.summary import summarise
from tams_app.summary.quality import SSIM_KINDS
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.rate_control import freeze_ns
from tests.session.virtual.runs import (
    LONG_ENOUGH,
    PARTICIPANT,
    WALL_NS,
    digest_of_run,
    run,
    short,
)
from tests.test_summary import KEYS

pytestmark = [pytest.mark.untimed, pytest.mark.timeout(600)]
VIEWS = ("eih", "gt", "gs")


@pytest.fixture(scope="module")
def whole(tmp_path_factory):
    """The folder and the digest of one trial on s3 until the operator has engaged the arm."""
    folder = tmp_path_factory.mktemp("virtual")
    return folder, digest_of_run(folder)


@pytest.fixture(scope="module")
def log(whole) -> SessionLog:
    return read_log(whole[0] / LOG_NAME)


@pytest.fixture(scope="module")
def summary(log):
    return summarise(log)


@pytest.mark.verify
def test_the_same_seed_gives_the_same_frames_and_the_same_log_in_another_process(whole, tmp_path):
    command = [sys.executable, "-m", "tests.session.virtual.runs", str(tmp_path)]
    again = subprocess.run(
        command, cwd=PROJECT_DIRECTORY, capture_output=True, text=True, check=False
    )
    assert again.returncode == 0, again.stderr
    assert again.stdout.strip() == whole[1]


def test_the_summary_has_all_keys_and_every_frame_is_scored(summary, log):
    assert set(summary) == set(KEYS)
    for view in VIEWS:
        figures = summary["views"][view]
        assert set(figures) == set(KEYS["views"][view])
        assert all(0.3 < figures[kind] < 1.0 for kind in SSIM_KINDS)
        captured = [one for one in log.captured if one.view == view]
        scored = [one for one in log.quality if one.view == view]
        assert [one.index for one in captured] == [one.index for one in scored]
        assert figures["ssim_n"]["received_ssim"] == figures["frames_shown"] > 30
        assert figures["live_ssim"] < figures["received_ssim"]
    assert all(summary["primary_view"][kind] is not None for kind in SSIM_KINDS)


def test_what_no_machine_did_is_null(summary):
    assert summary["system"] == {
        "cpu_percent": {"app": None, "helpers": None},
        "peak_rss_mb": None,
    }
    assert summary["control"]["scheduler"] == "virtual"
    assert summary["control"]["late"] == 0


def test_control_ticks_cameras_and_the_judge_keep_their_rates(log):
    assert log.header.wall_offset_ns == WALL_NS - START_NS
    assert {after.due_ns - before.due_ns for before, after in pairwise(log.ticks)} == {8_333_333}
    assert len(log.ticks) == 480
    period_ns = NS_PER_S // 10
    for place, view in enumerate(VIEWS):
        captured = [one for one in log.captured if one.view == view]
        assert [one.index for one in captured] == list(range(len(captured)))
        late_ns = [
            one.capture_ns - START_NS - place * period_ns // 3 - one.index * period_ns
            for one in captured
        ]
        assert all(-4 * NS_PER_MS < late <= 0 for late in late_ns)  # the world's last cycle
    assert {round((b.t_ns - a.t_ns) / NS_PER_MS, -1) for a, b in pairwise(log.scene)} <= {30, 40}


def test_no_frame_is_shown_sooner_than_camera_encoder_link_and_decoder_allow(log):
    network = load_config().networks["s3"]
    least_ms = network.latency_ms - network.jitter_ms + DELIVERY_NS / NS_PER_MS + 4.5 + 2.5
    captured = {(one.view, one.index): one.capture_ns for one in log.captured}
    ages_ms = [(one.shown_ns - captured[one.view, one.index]) / NS_PER_MS for one in log.shown]
    assert min(ages_ms) > least_ms
    assert float(np.median(ages_ms)) < least_ms + 60


def test_the_operator_waits_for_a_frame_arms_the_arm_and_moves_it(log, summary):
    first_shown_ns = min(one.shown_ns for one in log.shown)
    pressed_ns = next(tick.started_ns for tick in log.ticks if tick.controller.menu)
    assert pressed_ns > first_shown_ns
    assert "arm enabled" in [note.text for note in log.notes]
    assert max(tick.speed for tick in log.ticks if tick.arming == "engaged") > 0.02
    assert summary["arm"]["stops"] == []


def test_phases_allocations_and_capacity_are_recorded_as_live(log, summary):
    assert log.phases[0].phase is Phase.REACH
    assert log.phases[0].reason == "start"
    policy_steps = np.diff([one.t_ns for one in log.allocations]) / NS_PER_MS
    assert max(policy_steps) == pytest.approx(50.0)
    assert [one.capacity_kbps for one in log.capacities] == [3000.0]
    assert summary["uplink"]["utilisation"] > 0.5  # of four seconds, the start included
    assert summary["uplink"]["loss_fraction"] > 0.0
    fates = {packet.fate for packet in log.packets if packet.kind is PacketKind.MEDIA}
    assert fates >= {PacketFate.DELIVERED, PacketFate.LOST}


def test_which_view_the_operator_relied_on_is_told_by_phase(log, summary):
    assert summary["operator"]["kind"] == "seeing"
    relied = summary["operator"]["relied_on"]
    assert set(relied["by_phase"]) <= {phase.value for phase in Phase}
    for phase, shares in relied["by_phase"].items():
        assert set(shares) == set(VIEWS)
        assert sum(shares.values()) == pytest.approx(1.0, abs=0.001)
        assert relied["n"][phase] > 0
    assert sum(relied["n"].values()) == sum(bool(one.relied_on) for one in log.glances)
    assert 0.0 <= relied["agreement"] <= 1.0
    gaps_ms = np.diff([one.t_ns for one in log.glances]) / NS_PER_MS
    assert 1000 / 15 - 10 < float(np.median(gaps_ms)) < 1000 / 11 + 10


def test_the_bitstream_is_in_the_log(whole, log):
    frames = list(read_video(whole[0] / LOG_NAME, "gt"))
    assert [len(one.data) for one in frames] == [
        one.size_bytes for one in log.sent if one.view == "gt"
    ]


def test_without_frames_the_operator_knows_nothing_and_touches_nothing(tmp_path, monkeypatch):
    monkeypatch.setattr(
        trial_module, "ENGAGED_WITHIN_S", 2.5
    )  # longer than the operator needs to begin
    dark = {"networks.dark": {"loss": 1.0, "rate_kbps": 3000}, "network": "dark"}
    outcome = run(short(**dark), tmp_path)
    log = read_log(tmp_path / LOG_NAME)
    assert outcome.reason == "the operator never engaged"
    assert log.shown == []
    assert log.glances == []
    hands = [tick.controller for tick in log.ticks]
    assert not any(hand.menu or hand.trigger or hand.a or hand.b or hand.grip for hand in hands)
    assert {tick.speed_scale for tick in log.ticks} == {0.0}
    unshown = [one for one in log.quality if one.shown_ns is None and one.live is None]
    assert len(unshown) == len(log.quality) > 60


def test_a_recorded_hand_moves_the_arm_the_same_way_without_looking(whole, log, tmp_path):
    trajectory = {"rig.hand_trajectory": str(whole[0] / LOG_NAME)}
    run(short(**LONG_ENOUGH, **trajectory), tmp_path)  # where video is lost, the arm is slower
    again = read_log(tmp_path / LOG_NAME)
    assert again.glances == []
    assert [tick.arming for tick in again.ticks] == [tick.arming for tick in log.ticks]
    for was, now in zip(log.ticks, again.ticks, strict=True):
        np.testing.assert_allclose(
            now.controller.pose.position, was.controller.pose.position, atol=1e-9
        )
    np.testing.assert_allclose(
        again.ticks[-1].arm.tcp.position, log.ticks[-1].arm.tcp.position, atol=1e-6
    )
    told = summarise(again)["operator"]
    assert told.pop("kind") == "recorded"
    assert set(told.values()) == {None}


@pytest.mark.parametrize(
    ("changes", "error", "sentence"),
    [
        ({"recording.record_reference": True}, ConfigError, "recording.record_reference"),
        ({"network": "s9"}, ConfigError, "s9"),
        ({"rig.hand_trajectory": "/nowhere.mcap"}, LogError, "/nowhere.mcap"),
        ({"recording.min_free_mb": 1e12}, LogError, "MB are free"),
    ],
)
def test_what_cannot_run_is_said_in_one_sentence(changes, error, sentence, tmp_path):
    with pytest.raises(error, match=sentence):
        VirtualTrial(short(**changes), PARTICIPANT, tmp_path, WALL_NS)


def test_freezes_of_the_summary_and_of_the_scores_agree(log, summary):
    frozen = {view: any(one.frozen for one in log.quality if one.view == view) for view in VIEWS}
    for view in VIEWS:
        longest_s = summary["views"][view]["freezes"]["longest_s"]
        assert frozen[view] == (longest_s > freeze_ns(NS_PER_S // log.header.fps) / NS_PER_S)
