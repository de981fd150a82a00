"""Algorithm 1 against an independent statement of it: a decision table read from top to bottom."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.config import PhasesConfig
from tams_app.policy.phases import PhaseTracker, SmoothedSpeed, infer_phase
from tams_app.records import Phase

pytestmark = pytest.mark.untimed

THRESHOLDS = PhasesConfig()

# (edge, still, descending long enough after this period, closed) -> phase; None matches anything
DECISION_TABLE = [
    (+1, None, None, None, Phase.GRASP),
    (-1, None, None, None, Phase.RELEASE),
    (0, True, None, None, "previous"),
    (0, False, True, False, Phase.ALIGN),
    (0, False, False, False, Phase.REACH),
    (0, False, True, True, Phase.PRE_RELEASE),
    (0, False, False, True, Phase.TRANSPORT),
]


def by_table(speed, vertical, closed, was_closed, previous, timer, period):
    edge = int(closed) - int(was_closed)
    still = speed <= 0.005
    advanced = timer + period if vertical < -0.015 else 0.0
    long_enough = advanced >= 0.3
    for row_edge, row_still, row_long, row_closed, phase in DECISION_TABLE:
        wanted = (row_edge, row_still, row_long, row_closed)
        if all(
            w is None or w == g
            for w, g in zip(wanted, (edge, still, long_enough, closed), strict=True)
        ):
            keeps_timer = edge != 0 or still
            return (previous if phase == "previous" else phase), timer if keeps_timer else advanced
    raise AssertionError("the table has a hole")


speeds = st.one_of(st.sampled_from([0.0, 0.005, math.nextafter(0.005, 1), 0.1]), st.floats(0, 0.5))
verticals = st.one_of(
    st.sampled_from([-0.015, math.nextafter(-0.015, -1), 0.0]), st.floats(-0.5, 0.5)
)
timers = st.one_of(st.sampled_from([0.0, 0.3, 0.2999, 0.3 - 1 / 120]), st.floats(0, 2))


@given(
    speeds,
    verticals,
    st.booleans(),
    st.booleans(),
    st.sampled_from(Phase),
    timers,
    st.floats(0, 0.1),
)
def test_every_step_agrees_with_the_decision_table(
    speed, vertical, closed, was_closed, previous, timer, period
):
    decision = infer_phase(
        THRESHOLDS,
        speed=speed,
        vertical_speed=vertical,
        closed=closed,
        was_closed=was_closed,
        previous=previous,
        descending_s=timer,
        period_s=period,
    )
    expected = by_table(speed, vertical, closed, was_closed, previous, timer, period)
    assert (decision.phase, decision.descending_s) == expected


def run(tracker, seconds, closed, speed, vertical):
    for _ in range(round(seconds * 120)):
        tracker.step(speed=speed, vertical_speed=vertical, closed=closed, period_s=1 / 120)
    return tracker.phase


def test_a_whole_pick_and_place_passes_through_the_six_phases_in_order():
    tracker = PhaseTracker(THRESHOLDS)
    assert tracker.phase is Phase.REACH
    assert run(tracker, 1, False, 0.1, 0.0) is Phase.REACH
    assert run(tracker, 1, False, 0.05, -0.05) is Phase.ALIGN
    assert run(tracker, 1, True, 0.0, 0.0) is Phase.GRASP
    assert run(tracker, 1, True, 0.1, 0.05) is Phase.TRANSPORT
    assert run(tracker, 1, True, 0.05, -0.05) is Phase.PRE_RELEASE
    assert run(tracker, 1, False, 0.0, 0.0) is Phase.RELEASE
    assert run(tracker, 1, False, 0.1, 0.1) is Phase.REACH


def test_a_pause_within_a_descent_holds_the_phase_and_the_timer():
    tracker = PhaseTracker(THRESHOLDS)
    run(tracker, 0.2, False, 0.05, -0.05)
    run(tracker, 5.0, False, 0.001, 0.0)
    assert run(tracker, 0.15, False, 0.05, -0.05) is Phase.ALIGN


def test_the_first_command_to_a_gripper_of_unknown_state_is_an_edge():
    tracker = PhaseTracker(THRESHOLDS)
    assert run(tracker, 0.1, None, 0.1, 0.0) is Phase.REACH
    assert run(tracker, 0.1, True, 0.0, 0.0) is Phase.GRASP


@pytest.mark.parametrize("speed", [0.0, 0.1])
def test_a_gripper_that_is_not_known_any_more_is_not_claimed_to_hold_anything(speed):
    tracker = PhaseTracker(THRESHOLDS)
    assert run(tracker, 0.1, True, 0.1, -0.1) is Phase.TRANSPORT
    decision = tracker.step(speed=speed, vertical_speed=-0.1, closed=None, period_s=0.01)
    assert (decision.phase, decision.reason) == (Phase.REACH, "gripper not known any more")
    assert run(tracker, 1.0, None, speed, 0.0) is Phase.REACH
    assert run(tracker, 0.1, True, 0.0, 0.0) is Phase.GRASP


def test_a_gripper_that_is_open_and_then_not_known_releases_nothing():
    tracker = PhaseTracker(THRESHOLDS)
    assert run(tracker, 0.1, False, 0.1, 0.0) is Phase.REACH
    assert run(tracker, 0.1, None, 0.1, 0.0) is Phase.REACH


def test_smoothed_speed_starts_at_the_first_velocity():
    smoothed = SmoothedSpeed(0.1)
    smoothed.update(np.array([0.0, 0.0, 0.1]), 0)
    smoothed.update(np.array([0.0, 0.0, 0.099]), 10_000_000)
    assert smoothed.speed == pytest.approx(0.1)
    assert smoothed.vertical_speed == pytest.approx(-0.1)


@given(st.lists(st.integers(5_000_000, 50_000_000), min_size=2, max_size=40))
def test_smoothing_depends_on_time_and_not_on_how_it_is_cut(intervals):
    speed = SmoothedSpeed(0.1)
    t_ns, position = 0, np.zeros(3)
    speed.update(position, t_ns)
    speed.update(position, 10_000_000)  # initialised at rest
    t_ns = 10_000_000
    for interval_ns in intervals:
        t_ns += interval_ns
        position = position + np.array([0.0, 0.0, -0.2 * interval_ns * 1e-9])
        speed.update(position, t_ns)
    expected = 0.2 * (1 - math.exp(-sum(intervals) * 1e-9 / 0.1))
    assert speed.speed == pytest.approx(expected, rel=1e-6)
    assert speed.vertical_speed == pytest.approx(-expected, rel=1e-6)


def test_a_repeated_report_changes_nothing():
    smoothed = SmoothedSpeed(0.1)
    smoothed.update(np.zeros(3), 0)
    smoothed.update(np.array([0.001, 0, 0]), 10_000_000)
    before = smoothed.speed
    smoothed.update(np.array([0.001, 0, 0]), 10_000_000)
    assert smoothed.speed == before
