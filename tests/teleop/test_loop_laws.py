"""Laws that hold for any hand, any arm report, any tick interval."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, example, given, settings
from hypothesis import strategies as st

from tams_app.records import Activity, ArmFault, ArmState, CommandLink, ControllerStatus, Pose
from tams_app.rotation import Rotation
from tams_app.teleop.safety import ArmingState, Reason
from tests.teleop.laws import (
    CONFIG,
    LIMITS,
    MS,
    SLACK,
    assert_profile_is_kept,
    assert_stays_inside,
    assert_stops_after_release,
    drive,
    leg,
    legs,
    periods_ns,
)
from tests.teleop.motions import unit
from tests.teleop.rig import PERIOD_NS, READY_ROTATION, Bench, IntegratingArm

pytestmark = pytest.mark.waiting

slow = settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow])

wild = st.one_of(st.floats(-2, 2), st.sampled_from([math.nan, math.inf, 1e300]))


@slow
@given(legs(), st.sampled_from([(0.35, 0.0, 0.18), (0.2, 0.0, 0.02), (0.41, 0.05, 0.39)]))
def test_any_hand_at_any_rate_keeps_the_profile_and_stays_inside(
    stretches: list[dict[str, Any]], start: tuple[float, ...]
) -> None:
    bench = Bench(CONFIG, IntegratingArm(start))
    drive(bench, stretches)
    assert_profile_is_kept(bench)
    assert_stays_inside(bench)
    turns = [(pose.rotation * READY_ROTATION.inv()).magnitude() for pose in bench.arm.trail[::5]]
    assert max(turns) <= math.radians(LIMITS.cone_deg) + 1e-4


@slow
@example([leg([0, 0.5, 0], 3), leg([0, 0, 0.125], 19), leg([0, 0, 0], 9)], (0.5, -0.25, 0.0))
@example([leg([0, -0.14, 0], 29), leg([0, 0.5, 0], 21)], (0.5, 0.359375, 0.0))
@given(legs(), st.tuples(st.floats(0.3, 0.5), st.floats(-0.4, 0.4), st.floats(-0.05, 0.5)))
def test_from_outside_nothing_leads_further_out(
    stretches: list[dict[str, Any]], start: tuple[float, ...]
) -> None:
    bench = Bench(CONFIG, IntegratingArm(start))
    drive(bench, stretches)
    path = bench.path()
    low, high = np.array(LIMITS.box_min_mm) / 1000, np.array(LIMITS.box_max_mm) / 1000
    radius = np.hypot(path[:, 0], path[:, 1])
    outside = np.column_stack((low - path, path - high, radius - LIMITS.radius_max_mm / 1000))
    assert (np.diff(np.maximum(outside, 0.0), axis=0) <= 1e-6).all()
    assert_profile_is_kept(bench)


@pytest.mark.parametrize(
    ("start", "inward"),
    [
        ((0.30, 0.0, -0.02), (0, 0, 0.1)),
        ((0.46, 0.0, 0.2), (-0.1, 0, 0)),
        ((0.30, 0.36, 0.2), (0, -0.1, 0)),
        ((0.16, 0.0, 0.2), (0.1, 0, 0)),
    ],
)
def test_from_outside_inward_is_free(start: tuple[float, ...], inward: tuple[float, ...]) -> None:
    bench = Bench(CONFIG, IntegratingArm(start))
    bench.engage()
    bench.ask(*inward)
    bench.run(60)
    assert bench.linear()[-1] @ np.array(inward) >= 0.9 * 0.1**2


@st.composite
def mad_ticks(draw: st.DrawFn) -> list[dict[str, Any]]:
    """Samples, reports and links of any kind, also broken ones."""
    return draw(
        st.lists(
            st.fixed_dictionaries(
                {
                    "status": st.sampled_from([ControllerStatus.OK] * 6 + list(ControllerStatus)),
                    "hand": st.lists(wild, min_size=3, max_size=3).map(np.array),
                    "pose": st.sampled_from(["moves", "moves", "moves", "wild", "none"]),
                    "trigger": st.sampled_from([1.0, 1.0, 1.0, 0.0, 0.5, math.nan]),
                    "grip": st.sampled_from([0.0, 0.0, 0.0, 1.0, math.nan]),
                    "age_ns": st.sampled_from([0, 0, 0, 0, 50 * MS, 500 * MS, -500 * MS]),
                    "arm": st.sampled_from(["ok"] * 6 + ["none", "jump", "nan", "error", "mode"]),
                    "jump": unit,
                    "late_ns": st.sampled_from([0, 0, 0, 0, 90 * MS, 300 * MS]),
                    "period_ns": st.sampled_from(
                        [PERIOD_NS, PERIOD_NS, 0, 1, 3 * MS, 30 * MS, 99 * MS, 10**9, -MS]
                    ),
                    "faults": st.sampled_from([()] * 12 + [(Reason.SESSION_FAILED,)]),
                    "confirm": st.booleans(),
                }
            ),
            min_size=5,
            max_size=120,
        )
    )


def mad_input(bench: Bench, mad: dict[str, Any]) -> dict[str, Any]:
    now_ns = bench.now_ns + mad["period_ns"]
    sample = bench.hand.sample(now_ns, max(0, mad["period_ns"]) / 1e9)
    pose = sample.pose if mad["pose"] == "moves" else None
    if mad["pose"] == "wild":
        pose = Pose(mad["hand"], Rotation.identity())
    sample = replace(
        sample,
        status=mad["status"],
        pose=pose,
        pose_ns=now_ns - mad["age_ns"],
        buttons_ns=now_ns - mad["age_ns"],
        trigger=mad["trigger"],
        grip=mad["grip"],
    )
    arm: ArmState | None = bench.arm.report(now_ns - mad["late_ns"])
    assert arm is not None
    if mad["arm"] == "none":
        arm = None
    elif mad["arm"] == "jump":
        arm = replace(arm, tcp=replace(arm.tcp, position=arm.tcp.position + mad["jump"] * 0.1))
    elif mad["arm"] == "nan":
        arm = replace(arm, tcp=replace(arm.tcp, position=mad["hand"] * math.nan))
    elif mad["arm"] == "error":
        arm = replace(arm, fault=ArmFault(24, "C24"))
    elif mad["arm"] == "mode":
        arm = replace(arm, servo=None)
    return {
        "sample": sample,
        "arm": arm,
        "link": CommandLink(0, now_ns - mad["late_ns"], MS, 0, ""),
        "faults": mad["faults"],
        "confirm": mad["confirm"],
    }


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.too_slow])
@given(mad_ticks())
def test_no_input_makes_it_raise_or_command_what_is_not_finite_or_too_fast(
    ticks: list[dict[str, Any]],
) -> None:
    bench = Bench(CONFIG)
    bench.engage()
    bench.ask(0.1, 0.2, 0.1)
    bench.run(10)
    for mad in ticks:
        before = bench.outputs[-1].arming
        output = bench.tick(period_ns=mad["period_ns"], **mad_input(bench, mad))
        bench.arm.activity = Activity.IDLE
        if output.twist is not None:
            speed = float(np.linalg.norm(output.twist.linear))
            assert speed <= LIMITS.max_speed_mm_s / 1000 * SLACK
            assert float(np.linalg.norm(output.twist.angular)) <= LIMITS.max_rotation_rad_s * SLACK
        if output.arming is ArmingState.FAULT:
            assert output.reason is not None
            assert output.twist is None or (before.is_armed and output.twist.is_zero)
        if output.arming is ArmingState.DISARMED:
            assert output.twist is None
        if output.gripper is not None or output.deadman:
            assert mad["status"] is ControllerStatus.OK


@slow
@given(legs(), st.lists(unit.map(lambda v: 0.01 * v), min_size=1, max_size=7))
def test_reports_that_jump_about_do_not_break_the_profile(
    stretches: list[dict[str, Any]], noise: list[np.ndarray]
) -> None:
    bench = Bench(CONFIG)
    bench.engage()
    for stretch in stretches:
        bench.ask(*stretch["linear"])
        for k in range(stretch["ticks"]):
            report = bench.arm.report(bench.now_ns + PERIOD_NS)
            shifted = report.tcp.position + noise[k % len(noise)]
            bench.tick(arm=replace(report, tcp=replace(report.tcp, position=shifted)))
    assert_profile_is_kept(bench)


@slow
@given(unit, st.integers(5, 60), periods_ns)
def test_after_any_release_the_command_is_exactly_zero_in_time_and_stays(
    direction: np.ndarray, ticks: int, period_ns: int
) -> None:
    bench = Bench(CONFIG)
    bench.engage()
    bench.ask(*(0.6 * direction))
    for _ in range(ticks):
        bench.tick(period_ns=period_ns)
    bench.hand.trigger = 0.0
    for _ in range(math.ceil(250 * MS / period_ns)):
        bench.tick(period_ns=period_ns)
    assert_stops_after_release(bench)
    assert bench.outputs[-1].twist is not None
    assert bench.outputs[-1].twist.is_zero
