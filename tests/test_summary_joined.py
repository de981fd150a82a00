"""The logs of two computers as one summary: clocks that differ, and logs that do not belong."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.errors import LogError
from tams_app.link.messages import OPERATOR_FACT, SESSION_FACT
from tams_app.recording import FrameShown, SessionLog
from tams_app.records import (
    HandHeard,
    LinkHealth,
    StateHeard,
    StopRecord,
    UplinkSummary,
)
from tams_app.summary import summarise
from tams_app.summary.joined import clock_offsets, in_order, joined, summarise_joined
from tams_app.summary.tables import LogTables
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.synthetic_session import START_NS, Synthetic, header, rtp_timestamp
from tests.test_summary_operator import glance

pytestmark = pytest.mark.untimed

HOUR_NS = 3600 * NS_PER_S
UP_NS, DOWN_NS = 20 * NS_PER_MS, 24 * NS_PER_MS


def pair(
    seconds: float = 3.0, offset_ns: int = HOUR_NS, drift_ppm: float = 0.0, jitter_ns: int = 0
) -> tuple[SessionLog, SessionLog, SessionLog]:
    """The log of one computer, and those of two that did the same; the robot's clock is its clock.

    A time of the operator's side is `offset_ns` less, and the drift since the start.
    """
    whole = Synthetic(seconds).log()
    random = np.random.default_rng(0)

    def there(t_ns: int) -> int:
        return t_ns - offset_ns - round((t_ns - START_NS) * drift_ppm / 1e6)

    def late() -> int:
        return int(random.integers(0, jitter_ns + 1))

    robot = replace(whole, shown=[], facts={SESSION_FACT: "a"})
    robot.hands_received = [
        HandHeard(
            t_ns + UP_NS + late(), there(t_ns), there(t_ns) - NS_PER_MS, t_ns - DOWN_NS, "", 7
        )
        for t_ns in range(START_NS, whole.ended_ns, NS_PER_S // 120)
    ]
    operator = SessionLog(
        header(), there(whole.ended_ns), facts={SESSION_FACT: "a", OPERATOR_FACT: "7"}
    )
    operator.states_received = [
        StateHeard(there(t_ns + DOWN_NS + late()), t_ns, there(t_ns - UP_NS))
        for t_ns in range(START_NS, whole.ended_ns, NS_PER_S // 60)
    ]
    operator.shown = [
        FrameShown(one.view, rtp_timestamp(one.index), there(one.shown_ns)) for one in whole.shown
    ]
    return whole, robot, operator


def summarise_both(first: SessionLog, second: SessionLog) -> dict[str, Any]:
    robot, operator = in_order(first, second)
    offsets = clock_offsets(robot, operator)
    both = LogTables(joined(robot, operator, offsets))
    return summarise_joined(robot, operator, offsets, both)


def test_frames_shown_elsewhere_have_the_latency_that_they_had_to_within_the_uncertainty():
    whole, robot, operator = pair()
    one, both = summarise(whole), summarise_both(robot, operator)
    # the two ways differ by 4 ms, which nothing tells from an offset of 2 ms
    assert both["link"]["uncertainty_ms"] == pytest.approx(22.0)
    for view in ("eih", "gt", "gs"):
        assert both["views"][view]["frames_shown"] == one["views"][view]["frames_shown"]
        latency = both["views"][view]["latency_ms"]["p50"]
        assert latency == pytest.approx(one["views"][view]["latency_ms"]["p50"], abs=2.01)


def test_what_the_decoder_took_elsewhere_is_the_same_by_the_robot_s_clock():
    _, robot, operator = pair(offset_ns=3 * NS_PER_S)
    took_ns = 5 * NS_PER_MS
    operator.shown = [replace(one, received_ns=one.shown_ns - took_ns) for one in operator.shown]
    for view in summarise_both(robot, operator)["views"].values():
        assert view["latency_stages_ms"]["decoder"]["p50"] == pytest.approx(5.0)


def test_only_what_two_computers_leave_open_differs_from_the_summary_of_one():
    whole, robot, operator = pair(offset_ns=0)
    one, both = summarise(whole), summarise_both(robot, operator)
    assert {key for key in both if both[key] != one.get(key)} <= {"link", "views", "primary_view"}


def test_the_order_of_the_logs_does_not_matter():
    _, robot, operator = pair()
    assert summarise_both(robot, operator) == summarise_both(operator, robot)


@given(
    offset_s=st.floats(-1e6, 1e6),
    drift_ppm=st.floats(-100, 100),
    jitter_ms=st.integers(0, 80),
)
def test_the_truth_is_within_the_stated_uncertainty(
    offset_s: float, drift_ppm: float, jitter_ms: int
):
    offset_ns = round(offset_s * NS_PER_S)
    _, robot, operator = pair(2.0, offset_ns, drift_ppm, jitter_ms * NS_PER_MS)
    offsets = clock_offsets(robot, operator)
    drifted_ns = 2 * NS_PER_S * 100 / 1e6
    for one in operator.shown[::50]:
        truth_ns = one.shown_ns + offset_ns
        found_ns = int(offsets.to_robot(np.array([one.shown_ns]))[0])
        assert abs(found_ns - truth_ns) <= offsets.uncertainty_ns + drifted_ns + 2


def test_a_drift_of_a_long_session_is_followed():
    _, robot, operator = pair(60.0, drift_ppm=100.0)
    offsets = clock_offsets(robot, operator)
    drifted_ns = int(offsets.offset_ns[-1] - offsets.offset_ns[0])
    assert drifted_ns == pytest.approx(60e9 * 100 / 1e6, rel=0.2)


def test_what_the_link_did_is_told():
    _, robot, operator = pair()
    robot.hands_received[10] = replace(robot.hands_received[10], refusal="too old")
    robot.uplink = [
        UplinkSummary(START_NS + NS_PER_S, 9000, 200, 3, 8000, None, None, {}, {}),
    ]
    robot.link_health = [LinkHealth(START_NS, True, 0, 0, 0, {}, {"not authentic": 7})]
    link = summarise_both(robot, operator)["link"]
    heard = len(robot.hands_received)
    assert link["samples"] == {"heard": heard, "counted": heard - 1, "refused": {"too old": 1}}
    assert link["round_trip_ms"]["p50"] == pytest.approx(44.0)
    assert link["sample_age_ms"]["p50"] == pytest.approx(21.0, abs=2.01)
    assert link["state_age_ms"]["p50"] == pytest.approx(24.0, abs=2.01)
    assert link["video"] == {"packets": 200, "loss_fraction": 0.015}
    assert link["ignored"]["robot"] == {"not authentic": 7}


def test_stops_by_the_link_are_counted_per_minute_by_their_reason():
    _, robot, operator = pair(6.0)
    reasons = ["link gap", "tracking lost", "link lost", "link gap", "arm link lost"]
    robot.stops = [StopRecord(reason, START_NS, None) for reason in reasons]
    found = summarise_both(robot, operator)["link"]["stops_per_minute"]
    assert found == {
        "link gap": pytest.approx(20.0, rel=0.01),
        "link lost": pytest.approx(10.0, rel=0.01),
    }
    robot.stops = []
    assert summarise_both(robot, operator)["link"]["stops_per_minute"] == {}


def test_samples_of_a_controller_that_has_told_no_pose_yet_have_no_age():
    _, robot, operator = pair(2.0, -HOUR_NS)
    usual = summarise_both(robot, operator)["link"]
    before = robot.hands_received[: len(robot.hands_received) // 10]
    robot.hands_received[: len(before)] = [replace(one, pose_ns=0) for one in before]
    link = summarise_both(robot, operator)["link"]
    assert link["samples"] == usual["samples"]
    for figure in ("sample_age_ms", "command_latency_ms"):
        assert link[figure]["p99"] == pytest.approx(usual[figure]["p99"], abs=2.0)


def test_a_log_that_was_cut_off_makes_the_summary_incomplete():
    _, robot, operator = pair()
    assert summarise_both(robot, operator)["complete"]
    assert not summarise_both(robot, replace(operator, truncated=True))["complete"]


def test_logs_that_are_not_the_two_of_one_session_are_refused():
    whole, robot, operator = pair()
    for log in (robot, operator):
        with pytest.raises(LogError, match="not the two logs of one session"):
            in_order(log, log)
    for one, other in (
        (robot, replace(operator, facts={**operator.facts, SESSION_FACT: "b"})),
        (whole, operator),  # of one computer
    ):
        with pytest.raises(LogError, match="two different sessions"):
            in_order(one, other)


def test_sides_that_never_heard_of_each_other_cannot_be_joined():
    _, robot, operator = pair()
    with pytest.raises(LogError, match="nothing to join"):
        clock_offsets(replace(robot, hands_received=[]), operator)


def test_of_two_operators_in_one_session_each_is_joined_with_their_own_samples():
    _, robot, operator = pair()
    alone = summarise_both(robot, operator)
    another = [
        replace(one, sent_ns=one.sent_ns + HOUR_NS, pose_ns=one.pose_ns + HOUR_NS, operator=8)
        for one in robot.hands_received
    ]
    both = summarise_both(
        replace(robot, hands_received=[*another, *robot.hands_received]), operator
    )
    assert both["link"] == alone["link"]


def test_what_the_operator_saw_counts_for_the_phase_that_the_robot_was_in():
    _, robot, operator = pair()
    operator.glances = [glance(1.0 - HOUR_NS / NS_PER_S, {"gt": 1.0}, {"gt": 1.0})]
    operator.facts["operator"] = "seeing"
    summary = summarise_both(robot, operator)
    assert summary["operator"]["kind"] == "seeing"
    robot, operator = in_order(robot, operator)
    (seen,) = joined(robot, operator, clock_offsets(robot, operator)).glances
    assert abs(seen.t_ns - (START_NS + NS_PER_S)) <= 3 * NS_PER_MS


def test_before_and_after_the_operator_is_connected_no_rate_counts_as_off_its_target() -> None:
    _, robot, _ = pair(seconds=6.0)
    starved = START_NS + 2 * NS_PER_S
    robot.packets = [
        replace(one, size_bytes=one.size_bytes // 10) if one.entered_ns < starved else one
        for one in robot.packets
    ]
    assert summarise(robot)["views"]["eih"]["tracking_error"] > 0.2
    robot.hands_received = [one for one in robot.hands_received if one.t_ns > starved]
    assert summarise(robot)["views"]["eih"]["tracking_error"] < 0.01
