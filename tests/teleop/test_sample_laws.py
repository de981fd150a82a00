"""Laws that hold for any stream of controller samples."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from tams_app.records import Activity, ControllerSample, Pose
from tams_app.rotation import Rotation
from tams_app.teleop.safety import ArmingState
from tests.teleop.laws import (
    MS,
    assert_profile_is_kept,
    assert_stays_inside,
    assert_stops_after_release,
    commanded,
    leg,
)
from tests.teleop.motions import unit
from tests.teleop.rig import PERIOD_NS, Bench, IntegratingArm, make_config

pytestmark = pytest.mark.waiting

CONFIG = make_config()
many = settings(max_examples=50, deadline=None, suppress_health_check=[HealthCheck.too_slow])

# What a tracking runtime has been seen to send instead of a new, good sample.
TRICKS = [
    "duplicate",  # nothing new: pose, buttons and times of the sample before
    "frozen pose",  # buttons go on
    "frozen buttons",  # the pose goes on
    "late",  # a pose from 20 ms before the last
    "jump 5 cm",
    "jump 1 m",
    "origin",  # (0, 0, 0), as a runtime without tracking reports
    "nan",
    "huge",
    "none",
    "future",
]


@st.composite
def streams(draw: st.DrawFn) -> list[dict[str, Any]]:
    """Stretches of good samples with tricks and a trigger that chatters in between."""
    return draw(
        st.lists(
            st.fixed_dictionaries(
                {
                    "linear": unit.map(lambda v: 0.5 * v),
                    "angular": unit,
                    "good": st.integers(0, 25),
                    "trick": st.sampled_from(TRICKS),
                    "tricks": st.integers(0, 14),
                    "triggers": st.lists(
                        st.sampled_from([1.0, 1.0, 0.61, 0.6, 0.59, 0.5, 0.41, 0.4, 0.39, 0.0]),
                        min_size=1,
                        max_size=4,
                    ),
                    "grip": st.sampled_from([0.0, 0.0, 0.0, 1.0]),
                    "periods_ns": st.lists(
                        st.sampled_from([PERIOD_NS] * 6 + [0, -MS, MS, 3 * MS, 20 * MS, 39 * MS]),
                        min_size=1,
                        max_size=3,
                    ),
                }
            ),
            min_size=3,
            max_size=8,
        )
    )


def tricked(good: ControllerSample, last: ControllerSample, trick: str) -> ControllerSample:
    """`good` as a runtime with that trick would send it, after `last`."""
    assert good.pose is not None
    at = good.pose.position
    places = {
        "jump 5 cm": at + np.array([0.05, 0, 0]),
        "jump 1 m": at + np.array([0, -1.0, 0]),
        "origin": np.zeros(3),
        "nan": np.full(3, math.nan),
        "huge": np.full(3, 1e300),
    }
    if trick == "origin" and last.pose is not None and not last.pose.position.any():
        return replace(good, pose=last.pose, pose_ns=last.pose_ns)  # it does not change
    if trick in places:
        return replace(good, pose=Pose(places[trick], Rotation.identity()))
    return {
        "duplicate": last,
        "frozen pose": replace(good, pose=last.pose, pose_ns=last.pose_ns),
        "frozen buttons": replace(good, buttons_ns=last.buttons_ns, trigger=last.trigger),
        "late": replace(good, pose_ns=last.pose_ns - 20 * MS),
        "none": replace(good, pose=None),
        "future": replace(good, pose_ns=good.pose_ns + 10**9, buttons_ns=good.buttons_ns + 10**9),
    }[trick]


def play(bench: Bench, stream: list[dict[str, Any]]) -> None:
    """Engage, then play the stream; the operator confirms every fault as soon as that counts."""
    bench.engage()
    last = bench.hand.sample(bench.now_ns, 0.0)
    for stretch in stream:
        bench.ask(*stretch["linear"])
        bench.ask_turn(*stretch["angular"])
        bench.hand.grip = stretch["grip"]
        for k in range(stretch["good"] + stretch["tricks"]):
            period_ns = stretch["periods_ns"][k % len(stretch["periods_ns"])]
            bench.hand.trigger = stretch["triggers"][k % len(stretch["triggers"])]
            sample = bench.hand.sample(bench.now_ns + period_ns, max(0, period_ns) / 1e9)
            if k >= stretch["good"]:
                sample = tricked(sample, last, stretch["trick"])
            last = sample
            bench.tick(period_ns=period_ns, sample=sample, confirm=True)
            bench.arm.activity = Activity.IDLE


@many
@given(stream=streams(), start=st.sampled_from([(0.35, 0.0, 0.18), (0.2, 0.0, 0.02)]))
def test_any_stream_of_samples_keeps_the_profile_stays_inside_and_stops(
    stream: list[dict[str, Any]], start: tuple[float, ...]
) -> None:
    bench = Bench(CONFIG, IntegratingArm(start))
    play(bench, stream)
    assert_profile_is_kept(bench)
    assert_stays_inside(bench)
    assert_stops_after_release(bench)


@many
@given(stream=streams(), linear=unit.map(lambda v: 0.5 * v))
def test_after_any_stream_a_release_ends_in_exactly_zero(
    stream: list[dict[str, Any]], linear: np.ndarray
) -> None:
    bench = Bench(CONFIG)
    play(bench, [*stream, {**stream[-1], "linear": linear, "good": 20, "tricks": 0}])
    bench.hand.trigger = 0.0
    released = len(bench.outputs)
    bench.run(40)
    assert_stops_after_release(bench)
    for velocities in commanded(bench):
        assert not velocities[released + 13 :].any()


@pytest.mark.parametrize("trick", TRICKS)
def test_no_single_bad_sample_makes_the_arm_jump(trick: str) -> None:
    bench = Bench(CONFIG)
    stretch = {**leg([0, 0.1, 0], 1), "triggers": [1.0], "periods_ns": [PERIOD_NS]}
    play(bench, [{**stretch, "good": 40, "trick": trick, "tricks": 1}])
    bench.ask(0, 0, 0)
    bench.run(60)
    expected = 0.1 * 40 * PERIOD_NS / 1e9
    assert abs(bench.path()[-1][1] - expected) < 0.012  # a few ticks of the hand's own motion
    assert abs(bench.path()[-1][0] - 0.35) < 0.013


@pytest.mark.parametrize("trick", TRICKS)
def test_a_bad_sample_that_stays_stops_the_arm_within_200_ms(trick: str) -> None:
    bench = Bench(CONFIG)
    stretch = {**leg([0, 0.2, 0], 1), "triggers": [1.0], "periods_ns": [PERIOD_NS]}
    play(bench, [{**stretch, "good": 30, "trick": trick, "tricks": 30}])
    if trick.startswith("jump"):  # it jumped once and moves on from there: that is a good hand
        assert bench.outputs[-1].arming is ArmingState.ENGAGED
    else:
        assert not bench.linear()[-6:].any()


def test_a_trigger_that_chatters_around_a_threshold_does_not_chatter_the_arm() -> None:
    bench = Bench(CONFIG)
    bench.engage()
    bench.ask(0, 0.1, 0)
    states = set()
    for k in range(120):
        bench.hand.trigger = 0.55 + 0.1 * math.sin(k)
        states.add(bench.tick().arming)
    assert states == {ArmingState.ENGAGED}
    for k in range(240):
        bench.hand.trigger = 0.5 + 0.15 * math.sin(0.3 * k)
        bench.tick()
    assert_profile_is_kept(bench)
    assert_stops_after_release(bench)
