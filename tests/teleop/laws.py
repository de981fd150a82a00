"""What must hold of any run of the bench, and the hands that are tried."""

from __future__ import annotations

from typing import Any

import numpy as np
from hypothesis import strategies as st

from tams_app.config.motion import MAX_STOP_TIME_S
from tams_app.teleop.safety import ArmingState
from tests.teleop.motions import unit
from tests.teleop.rig import PERIOD_NS, Bench, make_config

MS = 1_000_000
SLACK = 1 + 1e-6
CONFIG = make_config()
LIMITS = CONFIG.limits
LEAST_S = 5e-4  # second differences over less say nothing
periods_ns = st.integers(1 * MS, 40 * MS)


@st.composite
def legs(draw: st.DrawFn) -> list[dict[str, Any]]:
    """What the hand does, a stretch at a time."""
    return draw(
        st.lists(
            st.fixed_dictionaries(
                {
                    "linear": unit.map(lambda v: 0.5 * v),
                    "angular": unit,
                    "ticks": st.integers(3, 40),
                    "trigger": st.sampled_from([1.0, 1.0, 1.0, 0.0]),
                    "grip": st.sampled_from([0.0, 0.0, 0.0, 1.0]),
                    "period_ns": st.one_of(st.just(PERIOD_NS), periods_ns),
                    "video_age_ns": st.sampled_from([None, 0, 600 * MS, 900 * MS, 1100 * MS]),
                }
            ),
            min_size=2,
            max_size=7,
        )
    )


def leg(linear: list[float], ticks: int) -> dict[str, Any]:
    """One stretch at the usual rate, engaged."""
    return {
        "linear": np.array(linear),
        "angular": np.zeros(3),
        "ticks": ticks,
        "trigger": 1.0,
        "grip": 0.0,
        "period_ns": PERIOD_NS,
        "video_age_ns": None,
    }


def drive(bench: Bench, stretches: list[dict[str, Any]]) -> None:
    """Engage and let the hand do all stretches."""
    bench.engage()
    for stretch in stretches:
        bench.ask(*stretch["linear"])
        bench.ask_turn(*stretch["angular"])
        bench.hand.trigger, bench.hand.grip = stretch["trigger"], stretch["grip"]
        for _ in range(stretch["ticks"]):
            bench.tick(period_ns=stretch["period_ns"], video_age_ns=stretch["video_age_ns"])


def commanded(bench: Bench) -> tuple[np.ndarray, np.ndarray]:
    """Linear and angular velocities as commanded, (ticks, 3) each."""
    return bench.linear(), bench.angular()


def assert_profile_is_kept(bench: Bench) -> None:
    """Speed, acceleration and jerk of the commands, from one tick to the next.

    A fault is exempt: it stops at once, by state 4.
    """
    intervals = np.maximum(np.diff(np.array(bench.times_ns)) / 1e9, 0.0)
    stopping = np.array([output.braking for output in bench.outputs])[1:]
    stopped = np.array([output.arming is ArmingState.FAULT for output in bench.outputs])[1:]
    motion, stop = LIMITS.motion, LIMITS.stop
    rough = 1e-9
    for commands, top, accelerations, jerks in (
        (
            commanded(bench)[0],
            LIMITS.max_speed_mm_s / 1000,
            (motion.acceleration_m_s2, stop.acceleration_m_s2),
            (motion.jerk_m_s3, stop.jerk_m_s3),
        ),
        (
            commanded(bench)[1],
            LIMITS.max_rotation_rad_s,
            (motion.acceleration_rad_s2, stop.acceleration_rad_s2),
            (motion.jerk_rad_s3, stop.jerk_rad_s3),
        ),
    ):
        assert np.isfinite(commands).all()
        assert np.linalg.norm(commands, axis=1).max() <= top * SLACK + rough
        changes = np.linalg.norm(np.diff(commands, axis=0), axis=1)
        allowed = np.where(stopping, accelerations[1], accelerations[0])
        assert ((changes <= allowed * intervals * SLACK + rough) | stopped).all()
        # Mean accelerations of neighbouring intervals, half of both apart.
        long_enough = (intervals > LEAST_S) & ~stopped
        rates = np.diff(commands, axis=0) / np.maximum(intervals, LEAST_S)[:, np.newaxis]
        apart = (intervals[1:] + intervals[:-1]) / 2
        swings = np.linalg.norm(np.diff(rates, axis=0), axis=1)
        either = stopping[1:] | stopping[:-1]
        bound = np.where(either, jerks[1], jerks[0]) * apart * SLACK + rough * 1e3
        assert ((swings <= bound) | ~(long_enough[1:] & long_enough[:-1])).all()


def assert_stays_inside(bench: Bench) -> None:
    path = bench.path()
    low, high = np.array(LIMITS.box_min_mm) / 1000, np.array(LIMITS.box_max_mm) / 1000
    radius = np.hypot(path[:, 0], path[:, 1])
    assert (path >= low - 1e-6).all()
    assert (path <= high + 1e-6).all()
    assert radius.max() <= LIMITS.radius_max_mm / 1000 + 1e-6
    assert radius.min() >= LIMITS.radius_min_mm / 1000 - 1e-6


def assert_stops_after_release(bench: Bench) -> None:
    """Not engaged: only the stop profile moves the arm, and after 100 ms nothing does.

    The command of a tick is in force from it on; braking began at the command of the tick before.
    """
    linear, angular = commanded(bench)
    left_ns = 0
    for k, output in enumerate(bench.outputs):
        if output.arming is ArmingState.ENGAGED:
            left_ns = bench.times_ns[k]
        elif linear[k].any() or angular[k].any():
            assert output.braking
            assert bench.times_ns[k] - left_ns <= MAX_STOP_TIME_S * 1e9
