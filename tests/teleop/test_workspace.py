from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tams_app.config import LimitsConfig
from tams_app.rotation import Rotation
from tams_app.teleop.trajectory import Profile, VelocityTrajectory
from tams_app.teleop.workspace import OutwardCap, RotationCone, Workspace
from tams_app.vectors import norm
from tests.teleop.motions import within

pytestmark = pytest.mark.waiting

LIMITS = LimitsConfig()
MOTION, STOP = Profile(1.5, 20.0), Profile(5.0, 130.0)
TURN, TURN_STOP = Profile(4.0, 60.0), Profile(12.0, 280.0)
DEADMAN_S = 0.1
SPACE = Workspace(LIMITS, MOTION, DEADMAN_S)
READY = Rotation.from_rotvec((np.pi, 0, 0))
CONE = RotationCone(LIMITS, TURN, DEADMAN_S, READY)

positions = (  # the arm's own column stands within 0.1 m of the axis
    st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-0.1, 0.5))
    .map(np.array)
    .filter(lambda p: math.hypot(p[0], p[1]) > 0.1)
)
velocities = st.lists(st.floats(-0.14, 0.14), min_size=3, max_size=3).map(np.array)


def excesses(space: Workspace, path: Sequence[np.ndarray]) -> np.ndarray:
    """(n, 8) for a path of n positions."""
    return np.array([space.excess(position) for position in path])


def normals_and_distances(position: np.ndarray) -> list[tuple[np.ndarray, float]]:
    low, high = np.array([0.15, -0.33, 0.005]), np.array([0.42, 0.33, 0.4])
    found = []
    for axis in range(3):
        e = np.eye(3)[axis]
        found += [(e, high[axis] - position[axis]), (-e, position[axis] - low[axis])]
    radius = math.hypot(position[0], position[1])
    if radius > 1e-3:
        radial = np.array([position[0], position[1], 0]) / radius
        found += [(radial, 0.425 - radius), (-radial, radius - 0.18)]
    return found


@given(positions, velocities)
def test_outside_a_bound_nothing_leads_further_out_of_it(
    position: np.ndarray, velocity: np.ndarray
) -> None:
    bounds = normals_and_distances(position)
    near_m = LIMITS.slow_down_mm / 1000.0
    if sum(distance < near_m for _, distance in bounds) != 1:
        return  # at a corner one cap may tilt the other; braking in bounds is judged after it
    capped = SPACE.cap(velocity, position)
    for normal, distance in bounds:
        if distance < 0:
            assert capped @ normal <= 1e-12


@given(positions, velocities)
def test_inward_is_free(position: np.ndarray, velocity: np.ndarray) -> None:
    inward = all(velocity @ normal <= 0 for normal, d in normals_and_distances(position) if d < 0.2)
    if inward and math.hypot(position[0], position[1]) < 0.4:
        np.testing.assert_allclose(SPACE.cap(velocity, position), velocity, atol=1e-12)


def test_the_outward_speed_shrinks_smoothly_to_zero_and_along_the_wall_stays_free() -> None:
    speeds = []
    for z in np.linspace(0.08, 0.005, 200):
        capped = SPACE.cap(np.array([0, 0.1, -0.25]), np.array([0.33, 0, z]))
        assert capped[1] == 0.1
        speeds.append(-capped[2])
    assert speeds[0] == 0.25
    assert speeds[-1] == 0.0
    assert (np.diff(speeds) <= 1e-12).all()
    assert np.abs(np.diff(speeds)).max() < 0.01


def test_the_ring_caps_towards_the_base_and_away_from_it() -> None:
    for x, sign in ((0.18, -1.0), (0.425, 1.0)):
        for gap, most in ((0.0, 0.0), (0.005, 0.05)):
            at, out = np.array([0.0, x - sign * gap, 0.2]), np.array([0, sign * 0.25, 0])
            assert 0.0 <= sign * ring_alone().cap(out, at)[1] <= most
            assert ring_alone().cap(-out, at)[1] == pytest.approx(-out[1])


def test_on_the_base_axis_the_ring_has_no_direction_and_the_box_still_counts() -> None:
    up = np.array([0.1, 0.0, 0.1])
    np.testing.assert_array_equal(SPACE.cap(up, np.array([0.0, 0.0, 0.2])), up)
    assert SPACE.cap(up, np.array([0.0, 0.0, 0.4]))[2] == 0.0


def test_the_slow_down_distance_of_the_configuration_counts() -> None:
    wide = Workspace(LIMITS.model_copy(update={"slow_down_mm": 120.0}), MOTION, DEADMAN_S)
    at, down = np.array([0.33, 0, 0.045]), np.array([0, 0, -0.25])
    assert -wide.cap(down, at)[2] == pytest.approx(0.25 * (0.04 - 5e-4) / 0.12)


@given(positions, velocities, st.integers(0, 12))
def test_what_is_admitted_brakes_inside_even_after_the_deadman_time(
    position: np.ndarray, velocity: np.ndarray, late: int
) -> None:
    plan = VelocityTrajectory(velocity, np.zeros(3), np.zeros(3), STOP)
    if not SPACE.admits(position, velocity, plan):
        return
    now = SPACE.excess(position)
    held = velocity * DEADMAN_S * late / 12
    path = [position + held + plan.at(float(t)).displacement for t in np.linspace(0, 0.12, 40)]
    worst = excesses(SPACE, path).max(axis=0)
    assert (worst <= np.maximum(now, 0.0) + 2e-4).all()


def test_far_is_measured_to_the_nearest_bound() -> None:
    at = np.array([0.3, 0.0, 0.055])
    assert SPACE.is_far(at, 0.049)
    assert not SPACE.is_far(at, 0.051)
    assert not SPACE.is_far(np.array([0.3, 0.0, 0.0]), 0.0)


# --- the caps, in numbers -------------------------------------------------------------------------


@given(st.floats(1e-4, 0.5), st.floats(0.5, 10), st.floats(0.01, 0.3))
def test_the_cap_is_the_speed_whose_stop_takes_just_that_distance(
    distance: float, acceleration: float, delay_s: float
) -> None:
    speed = OutwardCap(acceleration, delay_s, math.inf).at(distance)
    assert speed * delay_s + speed**2 / (2 * acceleration) == pytest.approx(distance)
    assert OutwardCap(acceleration, delay_s, 0.1).at(distance) == pytest.approx(
        min(speed, 0.1 * distance)
    )


@pytest.mark.parametrize("distance", [0.0, -1e-9, -0.1])
def test_on_a_bound_and_beyond_it_no_speed_leads_out(distance: float) -> None:
    assert OutwardCap(1.5, 0.15, math.inf).at(distance) == 0.0


def test_the_bounds_are_where_the_configuration_puts_them() -> None:
    corners = np.array([[0.15, -0.33, 0.005], [0.42, 0.33, 0.4], [0.18, 0, 0.1], [0, 0.425, 0.1]])
    excess = excesses(SPACE, corners)
    np.testing.assert_allclose(excess[0, :3], 0.0, atol=1e-12)
    np.testing.assert_allclose(excess[1, 3:6], 0.0, atol=1e-12)
    np.testing.assert_allclose([excess[2, 6], excess[3, 7]], 0.0, atol=1e-12)
    raised = Workspace(LIMITS.model_copy(update={"floor_mm": 50.0}), MOTION, DEADMAN_S)
    np.testing.assert_allclose(raised.excess((0.3, 0, 0.05))[2], 0.0, atol=1e-12)
    assert raised.cap(np.array([0, 0, -0.1]), np.array([0.33, 0, 0.05]))[2] == 0.0


def test_the_cap_allows_for_the_deadman_the_jerk_and_the_reaction() -> None:
    sharp = LIMITS.model_copy(update={"slow_down_mm": 1e-6})
    at, down = np.array([0.33, 0, 0.005 + 0.0105]), np.array([0, 0, -0.25])
    speed = -Workspace(sharp, MOTION, DEADMAN_S).cap(down, at)[2]
    delay_s = 0.1 + 1.5 / (2 * 20) + 0.02
    assert speed * delay_s + speed**2 / (2 * 1.5) == pytest.approx(0.01)  # the inset: 0.5 mm


def ring_alone() -> Workspace:
    wide = {"box_min_mm": (-600, -600, 5), "box_max_mm": (600, 600, 900)}
    return Workspace(LIMITS.model_copy(update=wide), MOTION, DEADMAN_S)


@pytest.mark.parametrize("degrees", [0, 30, 45, 110, 200, 300])
def test_the_ring_takes_the_radial_part_and_leaves_the_rest(degrees: float) -> None:
    out = np.array([math.cos(math.radians(degrees)), math.sin(math.radians(degrees)), 0])
    around = np.array([-out[1], out[0], 0])
    up = np.array([0, 0, 1.0])
    at = 0.42 * out + 0.3 * up
    wanted = 0.2 * out + 0.001 * around + 0.1 * up
    capped = ring_alone().cap(wanted, at)
    assert 0 < capped @ out < 0.04
    assert capped @ around == pytest.approx(0.001)
    assert capped @ up == pytest.approx(0.1)


def test_along_the_outer_wall_the_way_is_turned_with_it() -> None:
    for gap, turns in ((0.005, True), (0.03, False)):  # in 0.1 s, 0.2 m/s go 20 mm
        radius = 0.425 - gap
        along = np.array([0.25, 0.2, 0.05])  # +x leads out, +y along the wall
        straight = np.array([0.25, 0.0, 0.05])
        at = np.array([radius, 0, 0.3])
        difference = np.subtract(ring_alone().cap(straight, at), ring_alone().cap(along, at))
        bent = 0.1 * 0.2**2 / radius if turns else 0.0
        np.testing.assert_allclose(difference, [bent, -0.2, 0], atol=1e-12)


# --- judged states --------------------------------------------------------------------------------


def leaves(excess_now: np.ndarray, way: np.ndarray) -> float:
    """By how much a way (n, 8) of excesses breaks the law of the bounds; negative: it keeps it."""
    beyond = way.max(axis=0) - np.maximum(excess_now, 0.0)
    outward = np.where(excess_now > 0.0, np.diff(way, axis=0).max(axis=0), -1.0)
    return float(max(beyond.max(), outward.max()))


@settings(max_examples=250)
@given(positions, within(0.25), within(1.5), st.sampled_from([STOP, Profile(5.0, 5.0)]))
def test_exactly_what_brakes_by_the_law_is_admitted(
    position: np.ndarray, velocity: np.ndarray, acceleration: np.ndarray, stop: Profile
) -> None:
    plan = VelocityTrajectory(velocity, acceleration, np.zeros(3), stop)
    now = np.array(SPACE.excess(position))
    times = np.linspace(0, plan.duration_s, 9)
    braked = position + np.array([plan.at(float(t)).displacement for t in times])
    breach = max(leaves(now, excesses(SPACE, braked + h)) for h in (0.0, velocity * DEADMAN_S))
    if abs(breach) > 1e-6 and (np.abs(now) > 1e-6).all():
        assert SPACE.admits(position, velocity, plan) is (breach < 0)


SOFT = Profile(5.0, 5.0)
UP = np.array([0, 0, 1.0])
COLUMN = np.array([0.33, 0.0, 0.0])


def admits(height: float, speed: float, acceleration: float, stop: Profile) -> bool:
    """Whether a TCP at `height` [m], with motion along z, is admitted."""
    plan = VelocityTrajectory(speed * UP, acceleration * UP, np.zeros(3), stop)
    return SPACE.admits(COLUMN + height * UP, speed * UP, plan)


def test_a_way_that_leaves_and_comes_back_is_not_admitted() -> None:
    assert admits(0.3945, 0.05, -1.2, SOFT) is False  # 0.4 is the ceiling
    assert admits(0.39, 0.05, -1.2, SOFT) is True


def test_the_last_of_the_way_counts() -> None:
    plan = VelocityTrajectory(0.1 * UP, np.zeros(3), np.zeros(3), STOP)
    way = 0.1 * DEADMAN_S + plan.at(1.0).displacement[2]
    assert admits(0.4 - 0.999 * way, 0.1, 0.0, STOP) is False
    assert admits(0.4 - 1.001 * way, 0.1, 0.0, STOP) is True


def test_from_outside_a_way_that_turns_outward_again_is_not_admitted() -> None:
    assert admits(-0.02, 0.05, 0.0, SOFT) is True
    assert admits(-0.02, 0.05, -0.75, SOFT) is False  # 2.1 mm up, then 0.4 mm down again


@pytest.mark.parametrize("speed", [0.0, 0.1])
def test_from_outside_standing_and_going_along_the_bound_are_admitted(speed: float) -> None:
    along = np.array([0, speed, 0])
    plan = VelocityTrajectory(along, np.zeros(3), np.zeros(3), STOP)
    assert SPACE.admits(COLUMN - 0.02 * UP, along, plan)


def test_on_the_bound_itself_the_way_may_turn_as_long_as_it_stays_inside() -> None:
    assert admits(0.005, 0.05, -0.75, SOFT) is True
    assert admits(0.005, 0.05, -0.85, SOFT) is False


# --- the cone -----------------------------------------------------------------------------------


def offset_of(degrees: float, axis: tuple[float, float, float] = (0, 1, 0)) -> np.ndarray:
    turn = np.radians(degrees) * np.array(axis)
    return CONE.offset(READY.turned(turn))


def test_the_offset_is_the_rotation_from_ready_in_the_base_frame() -> None:
    np.testing.assert_allclose(offset_of(20), [0, np.radians(20), 0], atol=1e-9)


def test_turning_out_is_capped_at_the_cone_and_back_is_free() -> None:
    out = np.array([0.0, 0.5, 0.0])
    assert CONE.cap(out, offset_of(0))[1] == 0.5
    assert 0 < CONE.cap(out, offset_of(33))[1] < 0.3
    assert CONE.cap(out, offset_of(35))[1] == 0.0
    assert CONE.cap(out, offset_of(50))[1] == 0.0
    np.testing.assert_allclose(CONE.cap(-out, offset_of(50)), -out)


@given(
    st.lists(st.floats(-1, 1), min_size=3, max_size=3).map(np.array),
    st.lists(st.floats(-0.28, 0.28), min_size=3, max_size=3).map(np.array),
)
def test_what_the_cone_admits_brakes_inside(offset: np.ndarray, angular: np.ndarray) -> None:
    plan = VelocityTrajectory(angular, np.zeros(3), np.zeros(3), TURN_STOP)
    if not CONE.admits(offset, angular, plan):
        return
    start = READY.turned(offset)
    bound = max(math.radians(LIMITS.cone_deg), float(np.linalg.norm(offset)))
    for t_s in np.linspace(0, plan.duration_s, 10):
        turn = angular * DEADMAN_S + plan.at(float(t_s)).displacement
        angle = (start.turned(turn) * READY.inv()).magnitude()
        assert angle <= bound + 1e-4


def test_far_from_the_edge_of_the_cone_is_a_turn_about_any_axis() -> None:
    assert CONE.is_far(offset_of(10), math.radians(24))
    assert not CONE.is_far(offset_of(10), math.radians(26))


def test_across_the_edge_of_the_cone_the_way_is_turned_with_it() -> None:
    for degrees, turns in ((34.0, True), (30.0, False)):  # in 0.1 s, 0.5 rad/s go 2.9 deg
        angle = math.radians(degrees)
        offset = np.array([0, angle, 0])
        out, across = np.array([0, 0.5, 0]), np.array([0.3, 0.5, 0.4])
        difference = np.subtract(CONE.cap(out, offset), CONE.cap(across, offset))
        bent = 0.1 * 0.5**2 / math.tan(angle) if turns else 0.0
        np.testing.assert_allclose(difference, [-0.3, bent, -0.4], atol=1e-12)


def test_far_outside_the_cone_the_way_is_still_turned_inward() -> None:
    wide = RotationCone(LIMITS.model_copy(update={"cone_deg": 90}), TURN, DEADMAN_S, READY)
    capped = wide.cap(np.array([0.5, 0.1, 0]), np.array([0, 2.0, 0]))
    np.testing.assert_allclose(capped, [0.5, -0.1 * 0.5**2 / math.tan(1.5), 0], atol=1e-12)


@settings(max_examples=250)
@given(within(0.9), within(0.5), within(4.0))
def test_exactly_what_turns_and_brakes_inside_the_cone_is_admitted(
    offset: np.ndarray, angular: np.ndarray, acceleration: np.ndarray
) -> None:
    plan = VelocityTrajectory(angular, acceleration, np.zeros(3), TURN_STOP)
    start = READY.turned(offset)
    angles = []
    for t_s in np.linspace(0, plan.duration_s, 9):
        for held in (0.0, DEADMAN_S):
            turn = angular * held + plan.at(float(t_s)).displacement
            angles.append(float(np.linalg.norm(CONE.offset(start.turned(turn)))))
    breach = max(angles) - max(math.radians(LIMITS.cone_deg), float(np.linalg.norm(offset)))
    if abs(breach) > 1e-6:
        assert CONE.admits(offset, angular, plan) is (breach < 0)


@pytest.mark.parametrize(("angle", "speed"), [(0.0, 0.5), (0.61, 0.0), (0.62, 0.0), (0.0, 0.0)])
def test_without_an_offset_or_without_a_turn_the_angle_is_the_other(
    angle: float, speed: float
) -> None:
    offset, angular = np.array([0, angle, 0]), np.array([0, speed, 0])
    plan = VelocityTrajectory(angular, np.zeros(3), np.zeros(3), TURN_STOP)
    assert CONE.admits(offset, angular, plan)  # standing outside is admitted, too


def test_from_ready_a_turn_longer_than_the_cone_is_not_admitted() -> None:
    narrow = RotationCone(LIMITS.model_copy(update={"cone_deg": 3}), TURN, DEADMAN_S, READY)
    for speed, fits in ((0.1, True), (0.5, False)):
        plan = VelocityTrajectory(np.array([speed, 0, 0]), np.zeros(3), np.zeros(3), TURN_STOP)
        assert narrow.admits(np.zeros(3), np.array([speed, 0, 0]), plan) is fits


@pytest.mark.parametrize("speed", [0.1, 0.3, 0.5])
def test_turning_across_the_edge_of_the_cone_counts_what_it_adds_to_the_angle(speed: float) -> None:
    angular = np.array([speed, 0, 0])
    plan = VelocityTrajectory(angular, np.zeros(3), np.zeros(3), TURN_STOP)
    turn = speed * DEADMAN_S + plan.at(1.0).displacement[0]
    edge = 2 * math.acos(math.cos(math.radians(35) / 2) / math.cos(turn / 2))  # Pythagoras
    assert CONE.admits(np.array([0, edge - 1e-5, 0]), angular, plan)
    assert not CONE.admits(np.array([0, edge + 1e-5, 0]), angular, plan)


@pytest.mark.parametrize("degrees", [0, 20, 40, 60, 80])
def test_turning_out_at_any_slant_counts_what_it_adds_to_the_angle(degrees: float) -> None:
    slant = math.radians(degrees)
    angular = 0.4 * np.array([math.sin(slant), math.cos(slant), 0])
    plan = VelocityTrajectory(angular, np.zeros(3), np.zeros(3), TURN_STOP)
    turn = angular * DEADMAN_S + plan.at(1.0).displacement
    for edge in np.linspace(math.radians(25), math.radians(35), 100):
        offset = np.array([0, edge, 0])
        beyond = norm(CONE.offset(READY.turned(offset).turned(turn))) - math.radians(35)
        assert CONE.admits(offset, angular, plan) is (beyond < 0)


def test_a_turn_that_leads_straight_back_to_ready_is_admitted_from_anywhere() -> None:
    for angle in np.linspace(0.0005, 0.05, 1000):  # rounding may make a cosine larger than 1
        angular = np.array([0, -angle / DEADMAN_S, 0])
        plan = VelocityTrajectory(angular, np.zeros(3), np.zeros(3), TURN_STOP)
        assert CONE.admits(np.array([0, angle, 0]), angular, plan)
