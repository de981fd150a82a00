from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tams_app.config import LimitsConfig, stop_time_s
from tams_app.teleop.shaping import Profile, TrajectoryError, VelocityPlan, VelocityShaper

V = 0.25
MOTION = Profile(1.5, 20.0)
STOP = Profile(5.0, 100.0)
PERIOD_S = 1 / 120

unit = st.lists(st.floats(-1, 1), min_size=3, max_size=3).map(np.array)


def within(size: float) -> st.SearchStrategy[np.ndarray]:
    return unit.map(lambda v: size * v / max(1.0, float(np.linalg.norm(v))))


def norms(rows: list[np.ndarray]) -> np.ndarray:
    return np.linalg.norm(np.array(rows), axis=1)


@given(within(V), within(1.5), within(V))
def test_a_plan_keeps_acceleration_and_jerk_as_norms_and_ends_exactly(
    velocity: np.ndarray, acceleration: np.ndarray, target: np.ndarray
) -> None:
    plan = VelocityPlan(velocity, acceleration, target, MOTION)
    times = np.linspace(0, plan.duration_s, 60)
    states = [plan.at(float(t)) for t in times]
    accelerations = np.array([state.acceleration for state in states])
    assert np.linalg.norm(accelerations, axis=1).max() <= 1.5 * (1 + 1e-6)
    if plan.duration_s > 1e-6:
        jerks = np.diff(accelerations[:-1], axis=0) / np.diff(times[:-1])[:, np.newaxis]
        assert np.linalg.norm(jerks, axis=1).max() <= 20.0 * (1 + 1e-6)
    end = plan.at(plan.duration_s + 1e-3)
    assert (end.velocity == target).all()
    assert not end.acceleration.any()


@given(within(V), within(1.5))
def test_displacement_is_the_integral_of_velocity(
    velocity: np.ndarray, acceleration: np.ndarray
) -> None:
    plan = VelocityPlan(velocity, acceleration, np.zeros(3), STOP)
    times = np.linspace(0, plan.duration_s, 400)
    velocities = np.array([plan.at(float(t)).velocity for t in times])
    way = np.trapezoid(velocities, times, axis=0)
    np.testing.assert_allclose(plan.at(plan.duration_s).displacement, way, atol=2e-6)


@pytest.mark.parametrize("direction", [(1, 0, 0), (1, 1, 0), (1, -1, 1), (-2, 1, 3)])
def test_any_direction_stops_in_the_time_the_configuration_promises(
    direction: tuple[float, ...],
) -> None:
    velocity = V * np.array(direction) / np.linalg.norm(direction)
    plan = VelocityPlan(velocity, np.zeros(3), np.zeros(3), STOP)
    assert plan.duration_s == pytest.approx(stop_time_s(V, 5.0, 100.0), abs=1e-6)
    assert plan.duration_s <= 0.1 + 1e-6


@pytest.mark.parametrize("kind", ["linear", "angular"])
def test_from_any_state_of_motion_the_command_is_zero_100_ms_after_the_release_tick(
    kind: str,
) -> None:
    # The command of the release tick is already one period into the plan: 13 periods suffice.
    limits = LimitsConfig()
    if kind == "linear":
        top = limits.max_speed_mm_s / 1000
        motion = Profile(limits.motion.acceleration_m_s2, limits.motion.jerk_m_s3)
        stop = Profile(limits.stop.acceleration_m_s2, limits.stop.jerk_m_s3)
    else:
        top = limits.max_rotation_rad_s
        motion = Profile(limits.motion.acceleration_rad_s2, limits.motion.jerk_rad_s3)
        stop = Profile(limits.stop.acceleration_rad_s2, limits.stop.jerk_rad_s3)
    for size in np.linspace(0, motion.acceleration, 9):
        for angle in np.linspace(0, math.pi, 19):
            acceleration = size * np.array([math.cos(angle), math.sin(angle), 0])
            coast = acceleration * size / (2 * motion.jerk)
            fastest = min(top, math.sqrt(top**2 - coast[1] ** 2) - coast[0])
            for speed in (fastest, 0.7 * fastest):
                velocity = np.array([speed, 0, 0])
                plan = VelocityPlan(velocity, acceleration, np.zeros(3), stop)
                assert plan.duration_s <= 13 * PERIOD_S


@given(within(V), within(1.5), st.floats(0, 0.1))
def test_braking_never_goes_further_than_its_reach(
    velocity: np.ndarray, acceleration: np.ndarray, held_s: float
) -> None:
    shaper = VelocityShaper(V, MOTION, STOP)
    plan = shaper.braking_plan(velocity, acceleration)
    reach = shaper.braking_reach(velocity, acceleration, held_s)
    for t_s in np.linspace(0, plan.duration_s, 8):
        way = velocity * held_s + plan.at(float(t_s)).displacement
        assert np.linalg.norm(way) <= reach + 1e-9


targets = st.lists(st.tuples(within(V), st.integers(1, 12)), min_size=1, max_size=8)
jitters = st.lists(st.floats(1e-4, 0.03), min_size=1, max_size=9)


@settings(max_examples=40)
@given(targets, jitters, st.integers(0, 60), st.booleans())
def test_any_targets_at_any_rate_keep_speed_acceleration_and_jerk(
    targets: list[tuple[np.ndarray, int]], jitters: list[float], brake_at: int, refuse: bool
) -> None:
    shaper = VelocityShaper(V, MOTION, STOP)
    velocities, accelerations, steps, profiles = [np.zeros(3)], [np.zeros(3)], [], []
    wanted = [target for target, ticks in targets for _ in range(ticks)]
    for k, target in enumerate(wanted):
        if k == brake_at:
            shaper.brake()
        interval_s = jitters[k % len(jitters)]
        admissible = (lambda v, a, k=k: k % 7 != 5) if refuse else None
        velocities.append(shaper.step(target, interval_s, admissible))
        accelerations.append(shaper.acceleration)
        steps.append(interval_s)
        profiles.append(STOP if shaper.used_stop_profile else MOTION)
    intervals = np.array(steps)
    assert norms(velocities).max() <= V * (1 + 1e-6)
    changes = norms(list(np.diff(velocities, axis=0))) / intervals
    swings = norms(list(np.diff(accelerations, axis=0))) / intervals
    for change, swing, size, profile in zip(
        changes, swings, norms(accelerations)[1:], profiles, strict=True
    ):
        assert change <= profile.acceleration * (1 + 1e-6)
        assert size <= profile.acceleration * (1 + 1e-6)
        assert swing <= profile.jerk * (1 + 1e-6)


def test_a_target_is_reached_exactly_and_kept() -> None:
    shaper = VelocityShaper(V, MOTION, STOP)
    target = np.array([0.1, -0.2, 0.05])
    for _ in range(60):
        shaper.step(target, PERIOD_S)
    assert (shaper.velocity == target).all()
    assert not shaper.acceleration.any()


def test_turning_a_corner_at_full_speed_does_not_exceed_the_speed() -> None:
    shaper = VelocityShaper(V, MOTION, STOP)
    fastest = 0.0
    for k in range(200):
        corner = np.array([V, 0, 0]) if k % 40 < 20 else np.array([0.18, 0.17, 0])
        fastest = max(fastest, float(np.linalg.norm(shaper.step(corner, PERIOD_S))))
    assert V * 0.95 < fastest <= V * (1 + 1e-9)


def test_braking_runs_to_exactly_zero_before_any_target_is_followed() -> None:
    shaper = VelocityShaper(V, MOTION, STOP)
    target = np.array([0.2, 0.1, 0])
    for _ in range(60):
        shaper.step(target, PERIOD_S)
    shaper.brake()
    speeds = []
    while shaper.braking:
        speeds.append(float(np.linalg.norm(shaper.step(target, PERIOD_S))))
    assert speeds == sorted(speeds, reverse=True)
    assert speeds[-1] == 0.0
    assert len(speeds) <= 12
    assert shaper.at_rest


def test_a_state_that_is_refused_makes_it_brake() -> None:
    shaper = VelocityShaper(V, MOTION, STOP)
    for _ in range(30):
        shaper.step(np.array([V, 0, 0]), PERIOD_S)
    before = shaper.velocity[0]
    shaper.step(np.array([V, 0, 0]), PERIOD_S, lambda velocity, acceleration: False)
    assert shaper.braking
    assert shaper.velocity[0] < before


def test_an_acceleration_all_across_the_wanted_change_finds_its_way() -> None:
    shaper = VelocityShaper(V, MOTION, STOP)
    shaper.velocity, shaper.acceleration = np.array([0, 0.1, 0]), np.array([0, 0, 1.5])
    for _ in range(120):
        shaper.step(np.array([0, 0.2, 0]), PERIOD_S)
    assert (shaper.velocity == [0, 0.2, 0]).all()


def test_input_that_is_not_finite_raises_and_is_not_taken_on() -> None:
    shaper = VelocityShaper(V, MOTION, STOP)
    with pytest.raises(TrajectoryError):
        shaper.step(np.array([math.nan, 0, 0]), PERIOD_S)
    assert shaper.at_rest
