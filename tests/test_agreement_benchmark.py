"""When the agreement benchmark says that live and virtual runs agree."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.agreement_measures import PRIMARY, matched_ssim, view_measures
from benchmarks.agreement_motion import motion_difference
from benchmarks.agreement_verdicts import Agreement, compare, overall
from benchmarks.replay import Replay
from tams_app.records import FrameQuality
from tams_app.runtime.clock import NS_PER_MS, NS_PER_S
from tams_app.summary.tables import Span
from tests.synthetic_session import START_NS, Synthetic, capture_ns

pytestmark = pytest.mark.untimed

RATES = st.floats(10, 5000)


@pytest.mark.parametrize(
    ("pairs", "verdict"),
    [
        ([(1000.0, 960.0), (1000.0, 1030.0)], "met"),  # -4 % and +3 %
        ([(1000.0, 1100.0), (1000.0, 902.0)], "met"),  # far apart each, but not in the mean
        ([(1000.0, 1040.0), (1000.0, 1070.0)], "missed"),
        ([(1000.0, 930.0)], "missed"),
        ([(1000.0, None), (None, 1000.0)], "not measured"),
        ([(0.0, 0.0)], "not measured"),
    ],
)
def test_rates_agree_when_their_means_are_within_5_percent(pairs, verdict):
    assert compare("eih", "sent_kbps", pairs, 0.05, relative=True).verdict == verdict


def test_a_difference_is_live_minus_virtual_and_told_with_its_spread():
    row = compare("gt", "live_ssim", [(0.90, 0.89), (0.92, 0.90), (0.70, None)], 0.01)
    assert row.difference == pytest.approx(0.015)
    assert row.spread == pytest.approx(0.0070711, rel=1e-4)
    assert (row.live, row.virtual) == pytest.approx((0.91, 0.895))
    assert (row.seeds, row.verdict) == (2, "missed")


def test_what_nothing_was_promised_of_has_no_verdict():
    assert compare("gt", "latency_p50_ms", [(60.0, 90.0)]).verdict == ""


@given(st.lists(st.tuples(RATES, RATES), min_size=1, max_size=8))
def test_the_relative_difference_is_that_of_the_means(pairs):
    row = compare("eih", "sent_kbps", pairs, 0.05, relative=True)
    assert row.difference == pytest.approx((row.live - row.virtual) / row.live, abs=1e-9)


def row(verdict: str) -> Agreement:
    difference = {"met": 0.0, "missed": 1.0, "not measured": None, "": 1.0}[verdict]
    return Agreement("eih", "x", 1.0, 1.0, difference, None, 5, None if verdict == "" else 0.5)


@pytest.mark.parametrize(
    ("verdicts", "whole"),
    [
        (["met", "", "met"], "met"),
        (["met", "missed", "not measured"], "missed"),
        (["met", "not measured"], "not measured"),
        ([""], "not measured"),
    ],
)
def test_the_whole_agrees_only_if_every_promise_is_kept(verdicts, whole):
    assert overall([row(verdict) for verdict in verdicts]) == whole


def replay(later_ns: int = 0, scores: dict[int, float] | None = None) -> Replay:
    """Six seconds; everything `later_ns` later than usual; eih's received scores by index."""
    log = Synthetic(seconds=6.0, switch_s=3.0).log()
    for score_of, score in (scores or {}).items():
        at_ns = capture_ns(score_of) + later_ns
        log.quality.append(
            FrameQuality("eih", score_of, at_ns, at_ns, 0, False, None, score, score, score)
        )
    span = Span(START_NS + NS_PER_S, START_NS + 5 * NS_PER_S)
    return Replay(log, Path("session.mcap"), span)


def test_scores_are_compared_at_the_same_moments_of_the_hand():
    live = replay(scores={40: 0.9, 70: 0.8, 170: 0.1})  # the last lies outside the stretch
    virtual = replay(later_ns=3 * NS_PER_MS, scores={n: 0.5 + n / 1000 for n in range(30, 150)})
    assert matched_ssim(live, virtual, "eih", "received") == [
        (0.9, pytest.approx(0.54)),
        (0.8, pytest.approx(0.57)),
    ]
    assert matched_ssim(live, virtual, "gt", "received") == []


def test_a_moment_without_a_frame_in_the_other_run_is_left_out():
    live = replay(scores={40: 0.9, 70: 0.8})
    virtual = replay(scores={42: 0.7, 70: 0.6})
    assert matched_ssim(live, virtual, "eih", "live") == [(0.8, 0.6)]


def test_of_the_primary_view_only_frames_that_were_it_in_both_runs_count():
    scores = {40: 0.9, 130: 0.8}  # eih is the primary view from the switch at 3 s on
    assert matched_ssim(replay(scores=scores), replay(scores=scores), PRIMARY, "live") == [
        (0.8, 0.8)
    ]


def test_measures_are_of_the_stretch_alone():
    found = view_measures(replay(scores={10: 0.2, 40: 0.9, 140: 0.7}), "eih")
    assert found["received_ssim"] == pytest.approx(0.8)
    assert found["received_ssim_n"] == 2
    assert found["target_kbps"] == pytest.approx(2000.0, rel=0.02)  # 1000, then 3000
    assert found["latency_p50_ms"] == pytest.approx(60.0, abs=15.0)
    assert found["frames_missed_by_renderer_share"] == 0.0


def test_the_same_motion_is_no_distance_apart():
    found = motion_difference(replay(), replay())
    assert (found.rms_mm, found.largest_mm) == (0.0, 0.0)
    assert found.same_phases
    assert found.largest_phase_shift_s == 0.0
