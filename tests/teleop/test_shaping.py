from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tams_app.teleop.shaping import VelocityShaper
from tams_app.teleop.trajectory import Profile, TrajectoryError
from tests.teleop.motions import Case, plans, within

pytestmark = pytest.mark.waiting

V = 0.25
MOTION = Profile(1.5, 20.0)
STOP = Profile(5.0, 130.0)
PERIOD_S = 1 / 120


def norms(rows: list[np.ndarray]) -> np.ndarray:
    return np.linalg.norm(np.array(rows), axis=1)


@pytest.fixture
def shaper() -> VelocityShaper:
    return VelocityShaper(V, MOTION, STOP)


@given(plans(), st.floats(0, 0.1))
def test_braking_never_goes_further_than_its_reach(case: Case, held_s: float) -> None:
    shaper = VelocityShaper(case.top, case.motion, case.stop)
    plan = shaper.braking_trajectory(case.velocity, case.acceleration)
    reach = shaper.braking_reach(case.velocity, case.acceleration, held_s)
    for t_s in np.linspace(0, plan.duration_s, 8):
        way = case.velocity * held_s + plan.at(float(t_s)).displacement
        assert np.linalg.norm(way) <= reach + 1e-9


def test_the_reach_is_no_idle_bound(shaper: VelocityShaper) -> None:
    fast = np.array([0, V, 0])
    way = shaper.braking_trajectory(fast, np.zeros(3)).at(1.0).displacement[1]
    assert shaper.braking_reach(fast, np.zeros(3), 0.0) < 2 * way
    assert shaper.braking_reach(np.zeros(3), np.zeros(3), 0.1) == 0.0


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


def test_a_target_is_reached_exactly_and_kept(shaper: VelocityShaper) -> None:
    target = np.array([0.1, -0.2, 0.05])
    for _ in range(60):
        shaper.step(target, PERIOD_S)
    assert (shaper.velocity == target).all()
    assert not any(shaper.acceleration)


def test_turning_a_corner_at_full_speed_does_not_exceed_the_speed(shaper: VelocityShaper) -> None:
    fastest = 0.0
    for k in range(200):
        corner = np.array([V, 0, 0]) if k % 40 < 20 else np.array([0.18, 0.17, 0])
        fastest = max(fastest, float(np.linalg.norm(shaper.step(corner, PERIOD_S))))
        assert not shaper.used_stop_profile  # seen ahead, not braked away
    assert V * 0.95 < fastest <= V * (1 + 1e-9)


def test_braking_runs_to_exactly_zero_before_any_target_is_followed(shaper: VelocityShaper) -> None:
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


def test_braking_goes_on_as_it_began_however_often_it_is_asked_for(shaper: VelocityShaper) -> None:
    shaper.brake()
    assert not shaper.braking  # at rest there is nothing to brake
    for _ in range(10):
        shaper.step(np.array([0.2, 0.1, 0]), PERIOD_S)
    for _ in range(3):
        shaper.step(np.array([0.1, 0.2, 0]), PERIOD_S)
    plan = shaper.braking_trajectory(shaper.velocity, shaper.acceleration)
    for k in range(1, 14):
        shaper.brake()
        velocity = shaper.step(np.array([0, 0.2, 0]) if k < 5 else np.zeros(3), PERIOD_S)
        np.testing.assert_allclose(velocity, plan.at(k * PERIOD_S).velocity, atol=1e-12)


def test_a_state_that_is_refused_makes_it_brake(shaper: VelocityShaper) -> None:
    for _ in range(30):
        shaper.step(np.array([V, 0, 0]), PERIOD_S)
    before = shaper.velocity[0]
    shaper.step(np.array([V, 0, 0]), PERIOD_S, lambda velocity, acceleration: False)
    assert shaper.braking
    assert shaper.velocity[0] < before


def test_an_acceleration_all_across_the_wanted_change_finds_its_way(shaper: VelocityShaper) -> None:
    shaper.velocity, shaper.acceleration = np.array([0, 0.1, 0]), np.array([0, 0, 1.5])
    for _ in range(120):
        shaper.step(np.array([0, 0.2, 0]), PERIOD_S)
        assert np.linalg.norm(shaper.acceleration) <= 1.5 * (1 + 1e-8)
    assert (shaper.velocity == [0, 0.2, 0]).all()


def test_input_that_is_not_finite_raises_and_leaves_nothing_behind() -> None:
    shaper, other = VelocityShaper(V, MOTION, STOP), VelocityShaper(V, MOTION, STOP)
    with pytest.raises(TrajectoryError):
        shaper.step((math.nan, 0.0, 0.0), PERIOD_S)
    assert shaper.at_rest
    for target in ((0.1, 0.0, 0.0), (0.1, 0.2, 0.0), (0.0, -0.1, 0.2)):
        assert shaper.step(target, PERIOD_S) == other.step(target, PERIOD_S)
