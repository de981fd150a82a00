"""summary.json: its keys, and each definition on records whose answer is known."""

from __future__ import annotations

import json
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from tams_app.recording import FrameShown, Gap, SessionLog
from tams_app.records import (
    Allocation,
    DroppedFrame,
    LinkCapacity,
    PacketArrival,
    PacketFate,
    PacketKind,
    PacketRecord,
    Phase,
    PolicyInputs,
    StopRecord,
    SystemSample,
    UplinkReport,
)
from tams_app.summary import summarise
from tams_app.summary.quality import SSIM_KINDS
from tams_app.summary.tables import LogTables
from tams_app.summary.views import Windows, steps, windows
from tams_app.units import NS_PER_MS, NS_PER_S
from tams_app.video.core.stages import STAGES
from tests.synthetic_session import (
    START_NS,
    VIEWS,
    Synthetic,
    header,
    overshoot,
    tick,
)

pytestmark = pytest.mark.waiting


def keys(names: str, **below: Any) -> dict[str, Any]:
    """The keys of a part of the summary, and those below some of them."""
    return dict.fromkeys(names.split()) | below


SSIM = dict.fromkeys(SSIM_KINDS)
VIEW_KEYS = keys(
    "target_kbps_mean sent_kbps_mean tracking_error frames_damaged_at_camera frames_captured "
    "frames_sent frames_left_out frames_shown not_whole_s ssim_sampled_fraction frames_damaged",
    fps=keys("asked given"),
    frame_interval_ms=keys("p50 p95"),
    latency_ms=keys("p50 p95 p99"),
    latency_stages_ms={stage: keys("p50 p95") for stage in STAGES},
    own_latency_ms=keys("p50 p95"),
    freezes=keys("count total_s longest_s"),
    ssim_n=SSIM,
    **SSIM,
)
KEYS = keys(
    "schema version seed strategy network budget_mode duration_s complete records_lost",
    codecs=keys("encoder decoder"),
    predicted_views=[],
    missing=[],
    outcome=keys("completed success completion_time_s drops reason"),
    control=keys(
        "rate_hz ticks late skipped late_fraction scheduler",
        period_error_ms=keys("p50 p99 p99_9 max"),
        tick_cost_ms=keys("p50 p99 max"),
    ),
    arm=keys("servo", round_trip_ms=keys("p50 p99 max"), stops=[keys("t_s reason stop_time_ms")]),
    phases=[keys("t_s phase reason")],
    uplink=keys(
        "capacity_kbps budget_kbps_mean sent_kbps_mean utilisation loss_fraction "
        "residual_loss_fraction resent_fraction parity_fraction padding_fraction",
        queue_ms=keys("p50 p95 max"),
    ),
    views=dict.fromkeys(VIEWS, VIEW_KEYS),
    rates=keys("shortfall"),
    primary_view=keys(
        "sampled_fraction", time_weighted=SSIM, n=SSIM, missing_phases=[None], by_phase={}, **SSIM
    ),
    episodes=[],
    prediction=keys(
        "trusted_fraction camera_fits",
        error_mm=keys("p50 p95"),
        error_deg=keys("p50 p95"),
        newest_state_mm=keys("p50 p95"),
    ),
    operator=keys("kind glances_per_s relied_on uncertainty_mm"),
    system=keys("peak_rss_mb", cpu_percent=keys("app helpers")),
)


def tree(value: Any) -> Any:
    """The keys of nested dictionaries; of a list, those of its first entry."""
    if isinstance(value, dict):
        return {key: tree(item) for key, item in value.items()}
    if isinstance(value, list):
        return [tree(item) for item in value[:1]]
    return None


def leaves(value: Any) -> list[Any]:
    if isinstance(value, dict):
        return [leaf for item in value.values() for leaf in leaves(item)]
    return [value]


def packet(kind: PacketKind, sequence: int, fate: PacketFate, frame: int = 0) -> PacketRecord:
    t = START_NS + frame * 33 * NS_PER_MS
    departed = 0 if fate is PacketFate.OVERFLOW else t + 10 * NS_PER_MS
    delivered = t + 50 * NS_PER_MS if fate is PacketFate.DELIVERED else 0
    return PacketRecord("eih", kind, sequence, 1000, t, departed, delivered, fate, frame * 3000)


def test_the_keys_are_those_of_the_design() -> None:
    summary = summarise(Synthetic(2.0).log())
    assert tree(summary) == tree(KEYS)
    json.dumps(summary, allow_nan=False)  # plain numbers, and none of them NaN


def test_a_log_that_was_cut_or_damaged_says_what_is_missing() -> None:
    log = Synthetic(2.0).log()
    log.gaps = [Gap(START_NS + NS_PER_S // 2, START_NS + NS_PER_S)]
    log.truncated = True
    summary = summarise(log)
    assert summary["complete"] is False
    assert summary["missing"] == [
        {"start_s": 0.5, "end_s": 1.0},
        {"start_s": 2.0, "end_s": None},
    ]


def test_an_empty_log_has_the_same_keys_and_null_for_what_was_not_measured() -> None:
    summary = summarise(SessionLog(header(), START_NS))
    lists = {**KEYS, "phases": [], "arm": {**KEYS["arm"], "stops": []}}
    assert tree(summary) == tree(lists)
    for part in (summary["uplink"], summary["system"], summary["arm"]["round_trip_ms"]):
        assert set(leaves(part)) == {None}
    assert summary["views"]["eih"]["tracking_error"] is None
    assert summary["views"]["eih"]["freezes"]["count"] is None
    assert summary["outcome"]["completed"] is None
    assert summary["control"]["late_fraction"] is None
    json.dumps(summary, allow_nan=False)


# --- control and arm ----------------------------------------------------------------------------


def test_late_is_more_than_a_millisecond_after_due_or_skipped() -> None:
    log = SessionLog(header(), START_NS + NS_PER_S)
    log.ticks = [tick(number) for number in range(100)]
    log.ticks[10] = tick(10, late_ns=NS_PER_MS)  # just in time
    log.ticks[20] = tick(20, late_ns=NS_PER_MS + 1)
    log.ticks[50:] = [tick(number, skipped=3) for number in range(50, 100)]
    control = summarise(log)["control"]
    assert control["ticks"] == 100
    assert control["skipped"] == 3
    assert control["late"] == 4
    assert control["late_fraction"] == pytest.approx(4 / 103, abs=1e-6)
    assert control["period_error_ms"]["max"] == pytest.approx(3 * 1000 / 120, abs=1e-3)
    assert control["period_error_ms"]["p50"] == pytest.approx(0, abs=1e-3)


def test_ticks_missing_from_the_log_do_not_read_as_late() -> None:
    log = SessionLog(header(), START_NS + NS_PER_S)
    log.ticks = [tick(number) for number in range(100) if not 40 <= number < 60]
    control = summarise(log)["control"]
    assert control["late"] == 0
    assert control["period_error_ms"]["max"] < 0.01


def test_the_cost_of_a_tick_is_from_its_start_to_its_end() -> None:
    log = SessionLog(header(), START_NS + NS_PER_S)
    log.ticks = [tick(number, late_ns=500_000, cost_ns=number * 1000) for number in range(101)]
    assert summarise(log)["control"]["tick_cost_ms"] == {"p50": 0.05, "p99": 0.099, "max": 0.1}


def test_scheduler_and_codecs_are_what_was_learned_after_the_start() -> None:
    log = SessionLog(header(), START_NS)
    assert summarise(log)["codecs"] == {"encoder": None, "decoder": None}
    log.facts.update(scheduler="fifo", encoder="x264enc", decoder="avdec_h264")
    summary = summarise(log)
    assert summary["control"]["scheduler"] == "fifo"
    assert summary["codecs"] == {"encoder": "x264enc", "decoder": "avdec_h264"}


def test_each_round_trip_counts_once_and_only_when_acknowledged() -> None:
    log = SessionLog(header(), START_NS + NS_PER_S)
    base = tick(0)
    links = [(0, 0), (100, 400_000), (100, 400_000), (100, 400_000), (200, 600_000)]
    log.ticks = [
        replace(base, link=replace(base.link, acknowledged_ns=at, round_trip_ns=took))
        for at, took in links
    ]
    assert summarise(log)["arm"]["round_trip_ms"] == {"p50": 0.5, "p99": 0.598, "max": 0.6}


def test_a_stop_lasts_from_the_visible_fault_to_the_arm_at_rest() -> None:
    log = SessionLog(header(), START_NS)
    t = START_NS + 2 * NS_PER_S
    log.stops = [StopRecord("pose frozen", t, t + 87_500_000), StopRecord("arm lost", t, None)]
    assert summarise(log)["arm"]["stops"] == [
        {"t_s": 2.0, "reason": "pose frozen", "stop_time_ms": 87.5},
        {"t_s": 2.0, "reason": "arm lost", "stop_time_ms": None},
    ]


def test_system_load_is_the_mean_and_memory_the_peak() -> None:
    log = SessionLog(header(), START_NS)
    log.system = [
        SystemSample(START_NS, 60.0, {"render": 20.0, "link": 2.0}, 300.0),
        SystemSample(START_NS, 80.0, {"render": 30.0, "link": 4.0}, 280.0),
    ]
    assert summarise(log)["system"] == {
        "cpu_percent": {"app": 70.0, "helpers": 28.0},
        "peak_rss_mb": 300.0,
    }


# --- uplink -------------------------------------------------------------------------------------


def test_loss_counts_overflow_and_comes_before_repair() -> None:
    log = SessionLog(header(), START_NS)
    media, repair = PacketKind.MEDIA, PacketKind.REPAIR
    log.packets = [
        packet(media, 0, PacketFate.DELIVERED),
        packet(media, 1, PacketFate.LOST),
        packet(media, 2, PacketFate.OVERFLOW),
        packet(media, 3, PacketFate.LOST),
        packet(repair, 1, PacketFate.DELIVERED),
        packet(repair, 2, PacketFate.LOST),
        packet(repair, 2, PacketFate.DELIVERED),
        packet(repair, 3, PacketFate.LOST),
        packet(PacketKind.RTCP, 0, PacketFate.LOST),
    ]
    uplink = summarise(log)["uplink"]
    assert uplink["loss_fraction"] == pytest.approx(5 / 8)
    assert uplink["residual_loss_fraction"] == pytest.approx(1 / 4)


def test_of_a_real_network_rates_loss_and_queue_are_what_receivers_told() -> None:
    log = Synthetic(2.0).log()
    emulated = summarise(log)
    arrivals = tuple(
        PacketArrival(
            one.view,
            one.entered_ns,
            one.size_bytes,
            one.departed_ns - 5 * NS_PER_S if one.fate is PacketFate.DELIVERED else None,
        )
        for one in log.packets
        if one.kind is not PacketKind.RTCP
    )
    report = UplinkReport(log.ended_ns, sum(one.size_bytes for one in arrivals), arrivals)
    log.packets, log.policy_inputs = [], [PolicyInputs.of(report)]
    told = summarise(log)
    for key in ("sent_kbps_mean", "loss_fraction"):
        assert told["uplink"][key] == pytest.approx(emulated["uplink"][key])
    for view in VIEWS:
        sent = [summary["views"][view]["sent_kbps_mean"] for summary in (told, emulated)]
        assert sent[0] == pytest.approx(sent[1])
    assert told["uplink"]["queue_ms"]["max"] is not None
    unknown = ("residual_loss_fraction", "resent_fraction", "parity_fraction", "padding_fraction")
    assert {key: told["uplink"][key] for key in unknown} == dict.fromkeys(unknown)
    assert told["views"]["eih"]["tracking_error"] is None


def test_padding_is_no_video_but_fills_the_link() -> None:
    log = Synthetic(2.0).log()
    before = summarise(log)
    sent = [one for one in log.packets if one.kind is not PacketKind.RTCP]
    log.packets = log.packets + [replace(one, kind=PacketKind.PADDING) for one in sent]
    after = summarise(log)
    assert after["uplink"]["padding_fraction"] == 1.0
    assert after["uplink"]["sent_kbps_mean"] == before["uplink"]["sent_kbps_mean"]
    assert after["uplink"]["loss_fraction"] == before["uplink"]["loss_fraction"]
    assert after["uplink"]["utilisation"] > 1.8 * before["uplink"]["utilisation"]
    assert after["views"] == before["views"]


def test_a_repair_of_another_lap_of_the_sequence_repairs_nothing() -> None:
    log = SessionLog(header(), START_NS)
    log.packets = [
        packet(PacketKind.MEDIA, 7, PacketFate.LOST, frame=0),
        packet(PacketKind.MEDIA, 7, PacketFate.DELIVERED, frame=9000),
    ]
    assert summarise(log)["uplink"]["residual_loss_fraction"] == 0.5


def test_the_queue_is_the_time_in_the_bottleneck_of_what_crossed_it() -> None:
    log = SessionLog(header(), START_NS)
    base = packet(PacketKind.MEDIA, 0, PacketFate.DELIVERED)
    log.packets = [
        replace(base, sequence=number, departed_ns=base.entered_ns + number * NS_PER_MS)
        for number in range(1, 101)
    ]
    log.packets.append(packet(PacketKind.MEDIA, 500, PacketFate.OVERFLOW))
    assert summarise(log)["uplink"]["queue_ms"] == {"p50": 50.5, "p95": 95.05, "max": 100.0}


def test_utilisation_is_what_left_the_bottleneck_over_the_capacity() -> None:
    log = Synthetic(10.0).log()
    uplink = summarise(log)["uplink"]
    assert uplink["capacity_kbps"] == 6000.0
    assert uplink["sent_kbps_mean"] == pytest.approx(5000, rel=0.01)
    assert uplink["utilisation"] == pytest.approx(5000 / 6000, rel=0.01)
    assert uplink["budget_kbps_mean"] == 5520.0
    log.capacities = [
        LinkCapacity(START_NS, 12_000.0),
        LinkCapacity(START_NS + 5 * NS_PER_S, 4_000.0),
    ]
    uplink = summarise(log)["uplink"]
    assert uplink["capacity_kbps"] == pytest.approx(8000, rel=0.01)
    assert uplink["utilisation"] == pytest.approx(5000 / 8000, rel=0.01)


def test_an_uplink_without_a_bottleneck_has_no_capacity() -> None:
    log = Synthetic(2.0).log()
    log.capacities = [LinkCapacity(START_NS, float("inf"))]
    uplink = summarise(log)["uplink"]
    assert uplink["capacity_kbps"] is None
    assert uplink["utilisation"] is None
    assert uplink["sent_kbps_mean"] is not None


# --- views --------------------------------------------------------------------------------------


def test_rates_of_a_view_are_those_on_the_wire_with_repairs() -> None:
    log = Synthetic(10.0).log()
    assert summarise(log)["views"]["eih"]["sent_kbps_mean"] == pytest.approx(1000, rel=0.01)
    again = [replace(one, kind=PacketKind.REPAIR) for one in log.packets if one.view == "eih"]
    log.packets += again
    view = summarise(log)["views"]["eih"]
    assert view["sent_kbps_mean"] == pytest.approx(2000, rel=0.01)
    assert view["target_kbps_mean"] == 1000.0


@pytest.mark.parametrize("accuracy", [1.0, 0.9, 1.25])
def test_the_tracking_error_is_that_of_the_rate_on_the_wire(accuracy: float) -> None:
    views = summarise(Synthetic(5.0, accuracy=accuracy).log())["views"]
    for view in VIEWS:
        assert views[view]["tracking_error"] == pytest.approx(abs(accuracy - 1), abs=0.005)


def test_half_a_second_after_a_step_is_left_out_of_the_tracking_error() -> None:
    log = Synthetic(6.0, switch_s=3.0).log()
    overshoot(log, 3.0, 3.5, factor=3)
    assert summarise(log)["views"]["eih"]["tracking_error"] < 0.005
    overshoot(log, 3.5, 3.7, factor=3)
    assert summarise(log)["views"]["eih"]["tracking_error"] > 0.03


def test_a_change_of_the_target_by_a_tenth_is_no_step() -> None:
    log = SessionLog(header(), START_NS)
    log.allocations = [
        Allocation(START_NS + number, Phase.REACH, 6000.0, 5520.0, dict.fromkeys(VIEWS, target))
        for number, target in enumerate((1000, 1100, 1000, 1101, 900))
    ]
    assert steps(LogTables(log).targets, "eih").tolist() == [START_NS, START_NS + 3, START_NS + 4]


def windows_without(*missed: int) -> Windows:
    """Windows of a view whose camera missed these frames."""
    log = Synthetic(1.0).log()
    log.captured = [one for one in log.captured if one.index not in missed]
    return windows(LogTables(log), "eih")


def test_windows_span_no_gap_of_the_camera() -> None:
    found = windows_without(15, 16)
    assert len(found.start_ns) == (15 - 8) + (13 - 7)  # nor does one end with the gap
    np.testing.assert_allclose(found.error, 0, atol=0.01)


def test_the_time_of_one_missed_frame_counts() -> None:
    found = windows_without(15)
    assert len(found.start_ns) == 29 - 7
    assert sorted(set(found.error.round(3))) == pytest.approx([8 / 9 - 1, 0.0], abs=0.01)


@pytest.mark.parametrize(("rate_hz", "frames"), [(5, 8), (15, 8), (30, 8), (60, 16)])
def test_a_window_is_eight_frames_or_270_ms(rate_hz: int, frames: int) -> None:
    log = Synthetic(2.0).log()
    log.captured = [
        replace(one, capture_ns=START_NS + one.index * NS_PER_S // rate_hz) for one in log.captured
    ]
    found = windows(LogTables(log), "eih")
    np.testing.assert_allclose(
        found.end_ns - found.start_ns, frames * NS_PER_S / rate_hz, rtol=1e-6
    )
    np.testing.assert_allclose(found.sent_kbps, 1000 * rate_hz / 30, rtol=0.01)


def test_frames_dropped_at_the_source_count_as_frames_without_bytes() -> None:
    log = Synthetic(5.0).log()
    log.packets = [one for one in log.packets if (one.rtp_timestamp // 3000) % 2 == 0]
    assert summarise(log)["views"]["gs"]["tracking_error"] == pytest.approx(0.5, abs=0.01)


def test_frames_left_out_because_of_what_is_under_way_are_counted_by_view() -> None:
    log = Synthetic(4.0).log()
    log.dropped = [
        DroppedFrame("gs", 3, START_NS),
        DroppedFrame("gs", 4, START_NS, under_way=True),
        DroppedFrame("gt", 4, START_NS, under_way=True),
        DroppedFrame("gs", 5, START_NS, under_way=True),
    ]
    views = summarise(log)["views"]
    assert [views[view]["frames_left_out"] for view in ("eih", "gt", "gs")] == [0, 1, 2]


def test_latency_is_from_capture_to_the_mailbox() -> None:
    log = Synthetic(4.0, latency_ns=80 * NS_PER_MS).log()
    log.shown = [one for one in log.shown if one.index % 3]  # never shown: no latency
    log.shown.append(FrameShown("eih", 10**6, START_NS))  # never captured: not counted
    view = summarise(log)["views"]["eih"]
    assert view["latency_ms"] == {"p50": 80.0, "p95": 80.0, "p99": 80.0}
    assert (view["frames_captured"], view["frames_sent"], view["frames_shown"]) == (120, 120, 80)


def test_the_time_is_counted_for_which_what_was_shown_was_not_whole() -> None:
    log = Synthetic(4.0).log()
    assert summarise(log)["views"]["gt"]["not_whole_s"] is None, "where the log does not say"
    log.shown = [replace(one, whole=not 30 <= one.index < 45) for one in log.shown]
    assert summarise(log)["views"]["gt"]["not_whole_s"] == pytest.approx(0.5, abs=1e-3)
    log.shown = [one for one in log.shown if one.index <= 30 or one.index >= 60]
    assert summarise(log)["views"]["gt"]["not_whole_s"] == pytest.approx(1.0, abs=1e-3)


def test_a_freeze_is_a_frame_unchanged_for_more_than_200_ms() -> None:
    log = Synthetic(4.0).log()

    def gone(first: int, last: int) -> None:
        log.shown = [
            one for one in log.shown if not (one.view == "eih" and first <= one.index <= last)
        ]

    gone(31, 34)  # 5 frame times: 167 ms
    assert summarise(log)["views"]["eih"]["freezes"]["count"] == 0
    gone(61, 66)  # 7 frame times: 233 ms
    gone(91, 102)  # 13 frame times
    freezes = summarise(log)["views"]["eih"]["freezes"]
    assert freezes["count"] == 2
    assert freezes["total_s"] == pytest.approx(20 / 30, abs=1e-3)
    assert freezes["longest_s"] == pytest.approx(13 / 30, abs=1e-3)
    assert summarise(log)["views"]["gt"]["freezes"]["count"] == 0


def test_at_few_frames_a_second_a_freeze_is_two_missing_frames_in_a_row() -> None:
    log = Synthetic(2.0).log()  # 60 frames, now over 12 s
    log.captured = [
        replace(one, capture_ns=START_NS + one.index * NS_PER_S // 5) for one in log.captured
    ]
    log.shown = [
        replace(one, shown_ns=START_NS + one.index * NS_PER_S // 5 + 60_000_000)
        for one in log.shown
        if one.index not in (20, 40, 41)
    ]
    freezes = summarise(log)["views"]["eih"]["freezes"]
    assert freezes == {"count": 1, "total_s": 0.6, "longest_s": 0.6}


def test_a_frame_that_stays_away_until_the_end_is_a_freeze() -> None:
    log = Synthetic(4.0).log()
    log.shown = [one for one in log.shown if one.index < 60]
    freezes = summarise(log)["views"]["eih"]["freezes"]
    assert freezes["count"] == 1
    assert freezes["longest_s"] == pytest.approx(2.0 - 0.06 + 1 / 30, abs=0.001)
