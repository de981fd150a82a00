from __future__ import annotations

import math
import subprocess
import sys

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from ruckig import ControlInterface, InputParameter, Ruckig, Trajectory

from tams_app.config import LimitsConfig, stop_time_s
from tams_app.config.motion import MAX_STOP_TIME_S
from tams_app.teleop.limits import angular_profile, linear_profile
from tams_app.teleop.trajectory import (
    MotionState,
    Profile,
    TrajectoryError,
    VelocityTrajectory,
    coasting,
    one_axis_s,
    one_by_one_s,
)
from tams_app.vectors import Floats3, norm
from tests.teleop.motions import Case, motions_of, plans, within

pytestmark = pytest.mark.waiting

V = 0.25
LIMITS = LimitsConfig()
MOTION, STOP = linear_profile(LIMITS.motion), linear_profile(LIMITS.stop)
LINEAR = (LIMITS.max_speed_mm_s / 1000, MOTION, STOP)
ANGULAR = (
    LIMITS.max_rotation_rad_s,
    angular_profile(LIMITS.motion),
    angular_profile(LIMITS.stop),
)
PERIOD_S = 1 / 120
NOWHERE = np.zeros(3)
ACROSS = Case(  # both axes at once would take 0.49 s here
    0.298, Profile(4.009, 205.8), Profile(4.023, 422.4),
    np.array([0.2646, 0, 0]), 3.998 * np.array([math.cos(1.669), math.sin(1.669), 0]),
)  # fmt: skip


def assert_keeps(plan: VelocityTrajectory, target: np.ndarray, profile: Profile) -> None:
    """Acceleration and jerk as norms, and exactly the target at the end and after it."""
    times = np.linspace(0, plan.duration_s, 80)
    accelerations = np.array([plan.at(float(t)).acceleration for t in times])
    assert np.linalg.norm(accelerations, axis=1).max() <= profile.acceleration * (1 + 1e-6)
    if plan.duration_s > 1e-6:
        jerks = np.diff(accelerations[:-1], axis=0) / np.diff(times[:-1])[:, np.newaxis]
        assert np.linalg.norm(jerks, axis=1).max() <= profile.jerk * (1 + 1e-6)
    for t_s in (plan.duration_s, plan.duration_s + 1e-3):
        end = plan.at(t_s)
        assert (end.velocity == target).all()
        assert not any(end.acceleration)


@given(within(V), within(MOTION.acceleration), within(V))
def test_a_plan_keeps_acceleration_and_jerk_as_norms_and_ends_exactly(
    velocity: np.ndarray, acceleration: np.ndarray, target: np.ndarray
) -> None:
    assert_keeps(VelocityTrajectory(velocity, acceleration, target, MOTION), target, MOTION)


@given(within(0.01), within(0.1), within(0.01))
def test_a_plan_of_a_gentle_profile_keeps_it_too(
    velocity: np.ndarray, acceleration: np.ndarray, target: np.ndarray
) -> None:
    gentle = Profile(0.1, 3.0)
    assert_keeps(VelocityTrajectory(velocity, acceleration, target, gentle), target, gentle)


@example(ACROSS)
@given(plans())
def test_a_plan_begins_exactly_where_the_motion_is(case: Case) -> None:
    start = VelocityTrajectory(case.velocity, case.acceleration, NOWHERE, case.stop).at(0.0)
    assert not any(start.displacement)
    assert _same(start.velocity, case.velocity)
    assert _same(start.acceleration, case.acceleration)


def _same(one: Floats3, other: np.ndarray) -> bool:
    """Exactly, or both so small that the square is 0: no norm tells them from rest."""
    small = max(*map(abs, one), *map(abs, other)) < 1e-160
    return small or bool((other == one).all())


def test_after_its_end_a_plan_goes_on_at_the_target() -> None:
    target = np.array([0.1, -0.2, 0.05])
    plan = VelocityTrajectory(np.array([0, 0.1, 0]), np.array([0.5, 0, 0]), target, MOTION)
    end, later = plan.at(plan.duration_s - 1e-9), plan.at(plan.duration_s + 0.5)
    way = np.subtract(later.displacement, end.displacement)
    np.testing.assert_allclose(way, 0.5 * target, atol=1e-8)


@settings(max_examples=200)
@example(ACROSS)
@given(plans())
def test_any_stop_of_any_profile_keeps_that_profile(case: Case) -> None:
    plan = VelocityTrajectory(case.velocity, case.acceleration, NOWHERE, case.stop)
    assert_keeps(plan, NOWHERE, case.stop)


@example(ACROSS)
@given(plans())
def test_displacement_is_the_integral_of_velocity_and_velocity_of_acceleration(
    case: Case,
) -> None:
    plan = VelocityTrajectory(case.velocity, case.acceleration, NOWHERE, case.stop)
    times = np.linspace(0, plan.duration_s, 400)
    states = [plan.at(float(t)) for t in times]
    velocities = np.array([state.velocity for state in states])
    way = np.trapezoid(velocities, times, axis=0)
    np.testing.assert_allclose(states[-1].displacement, way, atol=1e-5)
    gained = np.trapezoid(np.array([state.acceleration for state in states]), times, axis=0)
    np.testing.assert_allclose(case.velocity + gained, NOWHERE, atol=1e-3 * case.top + 1e-6)


# --- how long a stop takes ------------------------------------------------------------------------


@pytest.mark.parametrize("direction", [(1, 0, 0), (1, 1, 0), (1, -1, 1), (-2, 1, 3)])
def test_any_direction_stops_as_fast_as_a_ramp_along_one_line_can(
    direction: tuple[float, ...],
) -> None:
    velocity = V * np.array(direction) / np.linalg.norm(direction)
    plan = VelocityTrajectory(velocity, NOWHERE, NOWHERE, STOP)
    assert plan.duration_s == pytest.approx(stop_time_s(V, STOP.acceleration, STOP.jerk), abs=1e-6)


@settings(max_examples=300)
@example(ACROSS)
@given(plans())
def test_no_stop_is_slower_than_losing_the_acceleration_and_then_the_speed(case: Case) -> None:
    plan = VelocityTrajectory(case.velocity, case.acceleration, NOWHERE, case.stop)
    bound_s = one_by_one_s(case.velocity, case.acceleration, NOWHERE, case.stop)
    assert plan.duration_s <= bound_s + 1e-7
    assert plan.duration_s <= MAX_STOP_TIME_S + 1e-7


@settings(max_examples=300)
@given(st.one_of(motions_of(*LINEAR), motions_of(*ANGULAR)))
def test_from_any_reachable_motion_the_stop_is_exactly_zero_within_100_ms(case: Case) -> None:
    plan = VelocityTrajectory(case.velocity, case.acceleration, NOWHERE, case.stop)
    at_rest = plan.at(MAX_STOP_TIME_S + 1e-9)
    assert not any(at_rest.velocity)
    assert not any(at_rest.acceleration)
    assert math.ceil(plan.duration_s / PERIOD_S - 1e-9) <= 12  # of the 13 ticks allowed


@pytest.mark.parametrize(("top", "motion", "stop"), [LINEAR, ANGULAR])
def test_also_a_stop_that_begins_while_the_arm_speeds_up_or_turns_takes_100_ms(
    top: float, motion: Profile, stop: Profile
) -> None:
    slowest = 0.0
    for size in np.linspace(0, motion.acceleration, 9):
        for angle in np.linspace(0, math.pi, 19):
            acceleration = size * np.array([math.cos(angle), math.sin(angle), 0])
            coast = acceleration * size / (2 * motion.jerk)
            fastest = min(top, math.sqrt(top**2 - coast[1] ** 2) - coast[0])
            plan = VelocityTrajectory(np.array([fastest, 0, 0]), acceleration, NOWHERE, stop)
            slowest = max(slowest, plan.duration_s)
    assert 0.085 < slowest <= MAX_STOP_TIME_S


def test_an_acceleration_across_does_not_make_the_stop_slow() -> None:
    plan = VelocityTrajectory(ACROSS.velocity, ACROSS.acceleration, NOWHERE, ACROSS.stop)
    assert plan.duration_s < 0.09
    assert (plan.at(0.0).velocity == ACROSS.velocity).all()
    assert (plan.at(-1.0).acceleration == ACROSS.acceleration).all()


# --- coasting -------------------------------------------------------------------------------------


@given(within(V), within(MOTION.acceleration), st.floats(0, 0.3))
def test_coasting_takes_the_acceleration_away_with_the_jerk_and_no_other_way(
    velocity: np.ndarray, acceleration: np.ndarray, t_s: float
) -> None:
    state = coasting(MotionState.moving(velocity, acceleration), MOTION.jerk, t_s)
    size = max(0.0, norm(acceleration) - MOTION.jerk * t_s)
    np.testing.assert_allclose(norm(state.acceleration), size, atol=1e-12)
    times = np.linspace(0, t_s, 301)
    started = MotionState.moving(velocity, acceleration)
    past = [coasting(started, MOTION.jerk, float(t)) for t in times]
    gained = np.trapezoid(np.array([s.acceleration for s in past]), times, axis=0)
    np.testing.assert_allclose(state.velocity, velocity + gained, atol=1e-5)
    way = np.trapezoid(np.array([s.velocity for s in past]), times, axis=0)
    np.testing.assert_allclose(state.displacement, way, atol=1e-5)


def test_a_planner_that_lives_until_the_process_ends_is_not_told_of_as_a_leak() -> None:
    program = (
        "import gc\n"
        "from tams_app.teleop.trajectory import Planner\n"
        "kept = [Planner()]; kept.append(kept); gc.freeze()"
    )
    ended = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, timeout=60, check=True
    )
    assert ended.stderr == ""


def test_what_is_not_finite_is_refused() -> None:
    with pytest.raises(TrajectoryError, match=r"velocity .* should be a valid number"):
        VelocityTrajectory(np.full(3, math.nan), NOWHERE, NOWHERE, STOP)
    with pytest.raises(TrajectoryError):
        VelocityTrajectory(NOWHERE, np.array([0, math.nan, 0]), NOWHERE, STOP)


# --- how good a plan is ---------------------------------------------------------------------------


@given(st.floats(0, 0.5), st.floats(-1, 1), st.floats(1.0, 50.0), st.floats(1.0, 2000.0))
def test_the_least_time_of_one_axis_is_the_time_that_ruckig_takes(
    change: float, start: float, acceleration: float, jerk: float
) -> None:
    request = InputParameter(1)
    request.control_interface = ControlInterface.Velocity
    request.max_velocity = [1e3]
    request.current_velocity, request.target_velocity = [-change], [0.0]
    request.current_acceleration = [start * acceleration]
    request.max_acceleration, request.max_jerk = [acceleration * (1 + 1e-9)], [jerk]
    trajectory = Trajectory(1)
    Ruckig(1).calculate(request, trajectory)
    least_s = one_axis_s(change, start * acceleration, acceleration, jerk)
    assert least_s == pytest.approx(trajectory.duration, rel=1e-6, abs=1e-8)


def best_split_s(along: float, across: float, change: float, profile: Profile) -> float:
    """The least time of all splits of acceleration and jerk over the two axes, by trying them."""
    least = math.inf
    room = max(profile.acceleration, math.hypot(along, across))
    for split in np.linspace(0.01, math.pi / 2 - 0.01, 200):
        share = min(max(split, math.asin(across / room)), math.acos(abs(along) / room))
        a_along, a_across = room * math.cos(share), room * math.sin(share)
        j_along, j_across = profile.jerk * math.cos(split), profile.jerk * math.sin(split)
        if min(a_along, a_across) > 0.06 * room:
            along_s = one_axis_s(change, along, a_along, j_along)
            across_s = one_axis_s(0.0, across, a_across, j_across)
            least = min(least, max(along_s, across_s))
    return least


def random_within(size: float, random: np.random.Generator) -> np.ndarray:
    direction = random.normal(size=3)
    return direction / np.linalg.norm(direction) * size * random.uniform()


@pytest.mark.parametrize("profile", [MOTION, STOP])
def test_plans_are_about_as_fast_as_the_best_split_of_their_limits(profile: Profile) -> None:
    random = np.random.default_rng(4)
    excess = []
    for _ in range(300):
        velocity, target = random_within(V, random), random_within(V, random)
        acceleration = random_within(0.95 * profile.acceleration, random)
        change = target - velocity
        along = float(acceleration @ change) / norm(change)
        across = norm(acceleration - along * change / norm(change))
        best_s = best_split_s(along, across, norm(change), profile)
        bound_s = one_by_one_s(velocity, acceleration, target, profile)
        plan = VelocityTrajectory(velocity, acceleration, target, profile)
        excess.append(plan.duration_s / min(best_s, bound_s) - 1)
    # Now and then the best lies apart from where the bisection looks.
    assert np.quantile(excess, [0.5, 0.97]) == pytest.approx([0, 0], abs=0.015)
    assert max(excess) < 0.5


def test_an_acceleration_near_its_bound_and_mostly_across_is_split_in_the_best_way() -> None:
    """The steeper the split, the less of the limit is left along the change of velocity."""
    along, across, change = 1.592, 4.294, 0.08854
    plan = VelocityTrajectory((-change, 0, 0), (along, across, 0), NOWHERE, STOP)
    assert plan.duration_s == pytest.approx(best_split_s(along, across, change, STOP), rel=0.01)
