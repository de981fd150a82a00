"""SSIM and damage in summary.json: each definition on records whose answer is known."""

from __future__ import annotations

from dataclasses import replace
from itertools import count

import pytest

from tams_app.recording import SessionLog
from tams_app.recording.topics import FrameCaptured
from tams_app.records import (
    FrameQuality,
    PacketFate,
    PacketKind,
    PacketRecord,
    Phase,
    PhaseChange,
    PinnedView,
)
from tams_app.summary import summarise
from tams_app.summary.quality import SSIM_KINDS
from tams_app.units import NS_PER_MS
from tests.synthetic_session import START_NS, VIEWS, Synthetic, capture_ns, header

pytestmark = pytest.mark.waiting

# the primary view: gt (the first of equals) everywhere but in ALIGN, where it is eih

NONE = dict.fromkeys(SSIM_KINDS, 0)


def quality(
    view: str,
    index: int,
    received: float | None,
    delivered: float | None = None,
    live: float | None = None,
) -> FrameQuality:
    return FrameQuality(
        view=view,
        index=index,
        capture_ns=capture_ns(index),
        shown_ns=None if received is None else capture_ns(index) + 60 * NS_PER_MS,
        age_ns=80 * NS_PER_MS,
        frozen=False,
        concealed=None,
        received=received,
        delivered=delivered,
        live=live,
    )


def log_of(*qualities: FrameQuality, phases: dict[int, Phase] | None = None) -> SessionLog:
    """`phases` begin with the capture of the frame that is their key."""
    log = SessionLog(header(), START_NS)
    log.quality = list(qualities)
    for index, phase in (phases or {0: Phase.REACH}).items():
        log.phases.append(PhaseChange(capture_ns(index), phase, ""))
    return log


def test_a_views_score_is_the_mean_over_its_scored_frames() -> None:
    log = log_of(
        quality("eih", 0, 0.9, 0.9, None),
        quality("eih", 1, None, 0.5, 0.4),
        quality("eih", 2, None),  # there was no time for it
        quality("eih", 3, 0.7, 0.7, 0.6),
        quality("gs", 0, 0.1, 0.1, 0.1),
    )
    view = summarise(log)["views"]["eih"]
    assert view["received_ssim"] == 0.8
    assert view["delivered_ssim"] == 0.7
    assert view["live_ssim"] == 0.5
    assert view["ssim_n"] == {**NONE, "received_ssim": 2, "delivered_ssim": 3, "live_ssim": 2}


def test_the_tasks_region_has_means_of_its_own() -> None:
    seen = replace(quality("gt", 0, 0.9, 0.9, 0.8), task_received=0.7, task_live=0.5)
    summary = summarise(log_of(seen, replace(quality("gt", 1, 0.7), task_received=0.5)))
    view, primary = summary["views"]["gt"], summary["primary_view"]
    assert view["task_received_ssim"] == primary["task_received_ssim"] == 0.6
    assert view["task_live_ssim"] == 0.5
    assert view["task_delivered_ssim"] is None
    assert view["ssim_n"]["task_received_ssim"] == 2


def test_the_primary_view_is_that_of_the_phase_at_capture() -> None:
    log = log_of(
        quality("gt", 0, 0.8), quality("eih", 0, 0.1), quality("gs", 0, 0.1),
        quality("gt", 1, 0.1), quality("eih", 1, 0.6), quality("gs", 1, 0.1),
        phases={0: Phase.REACH, 1: Phase.ALIGN},
    )  # fmt: skip
    primary = summarise(log)["primary_view"]
    assert list(primary["by_phase"]) == ["REACH", "ALIGN"]
    assert primary["by_phase"]["REACH"]["received_ssim"] == 0.8
    assert primary["by_phase"]["ALIGN"]["received_ssim"] == 0.6
    assert primary["by_phase"]["ALIGN"]["n"]["received_ssim"] == 1
    assert primary["n"] == {**NONE, "received_ssim": 2}
    assert primary["missing_phases"] == ["GRASP", "TRANSPORT", "PRE_RELEASE", "RELEASE"]


def test_the_primary_view_is_the_one_that_was_pinned_at_capture() -> None:
    views = {"gt": 0.8, "eih": 0.6, "gs": 0.4}
    log = log_of(
        *(quality(view, index, score) for index in range(6) for view, score in views.items())
    )
    log.captured = [
        FrameCaptured(view, index, capture_ns(index)) for index in range(6) for view in views
    ]
    log.pins = [PinnedView(capture_ns(2), "eih"), PinnedView(capture_ns(4), "")]
    primary = summarise(log)["primary_view"]
    assert primary["by_phase"]["REACH"]["received_ssim"] == pytest.approx(
        (4 * 0.8 + 2 * 0.6) / 6, abs=1e-4
    )
    assert primary["sampled_fraction"] == 1.0


def test_overall_is_the_unweighted_mean_of_the_phases_with_the_time_weighted_beside_it() -> None:
    reach = [quality("gt", index, 0.9, 0.9) for index in range(9)]
    skipped = [quality("gt", index, None) for index in range(9, 18)]  # time counts, scores do not
    align = [quality("eih", index, 0.6, 0.3) for index in range(18, 20)]
    log = log_of(*reach, *skipped, *align, phases={0: Phase.REACH, 18: Phase.ALIGN})
    primary = summarise(log)["primary_view"]
    assert primary["received_ssim"] == pytest.approx(0.75)
    assert primary["delivered_ssim"] == pytest.approx(0.6)
    assert primary["time_weighted"]["received_ssim"] == pytest.approx(0.87)
    assert primary["live_ssim"] is None
    assert primary["time_weighted"]["live_ssim"] is None


def test_the_sampled_fraction_is_of_all_frames_captured() -> None:
    told = [
        quality("gt", 0, 0.9, 0.9),
        quality("gt", 1, None, 0.8, 0.7),
        quality("gt", 2, None),  # there was no time for it
        quality("eih", 3, None, None, 0.5),
    ]
    log = log_of(*told, phases={0: Phase.REACH, 3: Phase.ALIGN})
    log.captured = [
        FrameCaptured(view, index, capture_ns(index)) for view in VIEWS for index in range(5)
    ]  # the last ones were not told of: the helper had gone
    summary = summarise(log)
    assert summary["views"]["gt"]["ssim_sampled_fraction"] == pytest.approx(2 / 5)
    assert summary["views"]["gs"]["ssim_sampled_fraction"] == 0
    primary = summary["primary_view"]
    assert primary["by_phase"]["REACH"]["sampled_fraction"] == pytest.approx(2 / 3, abs=1e-6)
    assert primary["by_phase"]["ALIGN"]["sampled_fraction"] == pytest.approx(1 / 2)
    assert primary["sampled_fraction"] == pytest.approx(3 / 5)
    log.captured = []
    assert summarise(log)["primary_view"]["sampled_fraction"] is None


def test_a_phase_that_comes_back_is_one_phase_and_before_the_first_there_is_none() -> None:
    log = log_of(
        quality("gt", 0, 0.1), quality("gt", 1, 0.9), quality("eih", 2, 0.5), quality("gt", 3, 0.7),
        phases={1: Phase.REACH, 2: Phase.ALIGN, 3: Phase.REACH},
    )  # fmt: skip
    by_phase = summarise(log)["primary_view"]["by_phase"]
    assert by_phase["REACH"]["received_ssim"] == pytest.approx(0.8)
    assert by_phase["REACH"]["n"]["received_ssim"] == 2


def renumbered(packets: list[PacketRecord]) -> list[PacketRecord]:
    """With RTP sequences as a payloader counts them: one by one, in each view."""
    counts = {view: count() for view in VIEWS}
    return [replace(one, sequence=next(counts[one.view])) for one in packets]


def test_damage_counts_shown_frames_up_to_the_next_keyframe() -> None:
    log = Synthetic(1.0).log()  # 30 frames, only the first is a keyframe
    log.packets = renumbered(log.packets)
    assert [summarise(log)["views"][view]["frames_damaged"] for view in VIEWS] == [0, 0, 0]
    hit = next(one for one in log.packets if one.view == "gt" and one.rtp_timestamp == 20 * 3000)
    place = log.packets.index(hit)
    log.packets[place] = replace(hit, delivered_ns=0, fate=PacketFate.LOST)
    log.shown = [one for one in log.shown if one.index != 20]
    assert summarise(log)["views"]["gt"]["frames_damaged"] == 9
    assert summarise(log)["views"]["eih"]["frames_damaged"] == 0


def test_what_loss_took_is_told_apart_from_what_coding_took() -> None:
    log = Synthetic(1.0).log()
    log.phases = [PhaseChange(capture_ns(0), Phase.REACH, "")]
    scores = [0.5 if index > 20 else 0.9 for index in range(30)]
    told = [quality("gt", index, score) for index, score in enumerate(scores)]
    log.quality = [replace(one, shown_ns=None) if one.index == 20 else one for one in told]
    log.packets = renumbered(log.packets)
    hit = next(one for one in log.packets if one.view == "gt" and one.rtp_timestamp == 20 * 3000)
    log.packets[log.packets.index(hit)] = replace(hit, delivered_ns=0, fate=PacketFate.LOST)
    log.shown = [one for one in log.shown if one.index != 20]
    reach = summarise(log)["primary_view"]["by_phase"]["REACH"]
    assert reach["damaged_fraction"] == pytest.approx(9 / 29, abs=1e-4)
    assert reach["undamaged_received_ssim"] == pytest.approx(0.9)
    resent = replace(hit, kind=PacketKind.REPAIR, fate=PacketFate.DELIVERED, delivered_ns=1)
    log.packets.append(replace(resent, delivered_ns=capture_ns(29), rtp_timestamp=29 * 3000))
    again = summarise(log)["primary_view"]["by_phase"]["REACH"]
    assert again["packets_per_frame"] == reach["packets_per_frame"]  # a resend is no new packet
    in_all = [one for one in log.packets if one.view == "gt" and one.kind is PacketKind.MEDIA]
    assert reach["packets_per_frame"] == pytest.approx(len(in_all) / 30, abs=1e-4)


def test_without_packets_concealment_is_unknown() -> None:
    log = Synthetic(1.0).log()
    log.packets = []
    log.phases = [PhaseChange(capture_ns(0), Phase.REACH, "")]
    log.quality = [quality("gt", 0, 0.9)]
    summary = summarise(log)
    assert summary["views"]["gt"]["frames_damaged"] is None
    reach = summary["primary_view"]["by_phase"]["REACH"]
    assert reach["damaged_fraction"] is None
    assert reach["undamaged_received_ssim"] is None
    assert reach["packets_per_frame"] is None
