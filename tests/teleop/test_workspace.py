from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from tams_app.config import LimitsConfig
from tams_app.teleop.quaternion import of_rotation, to_rotation, turned
from tams_app.teleop.shaping import Profile, VelocityPlan
from tams_app.teleop.workspace import RotationCone, Workspace

LIMITS = LimitsConfig()
MOTION, STOP = Profile(1.5, 20.0), Profile(5.0, 100.0)
TURN, TURN_STOP = Profile(4.0, 60.0), Profile(12.0, 250.0)
DEADMAN_S = 0.1
SPACE = Workspace(LIMITS, MOTION, DEADMAN_S)
READY = Rotation.from_euler("x", 180, degrees=True)
CONE = RotationCone(LIMITS, TURN, DEADMAN_S, READY)

positions = (  # the arm's own column stands within 0.1 m of the axis
    st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-0.1, 0.5))
    .map(np.array)
    .filter(lambda p: math.hypot(p[0], p[1]) > 0.1)
)
velocities = st.lists(st.floats(-0.14, 0.14), min_size=3, max_size=3).map(np.array)


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
    if sum(distance < 0 for _, distance in bounds) != 1:
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
            at = np.array([0.0, x - sign * gap, 0.2])
            ringed = Workspace(
                LIMITS.model_copy(
                    update={"box_min_mm": (-500, -500, 5), "box_max_mm": (500, 500, 400)}
                ),
                MOTION,
                DEADMAN_S,
            )
            assert 0.0 <= sign * ringed.cap(np.array([0, sign * 0.25, 0]), at)[1] <= most
            assert ringed.cap(np.array([0, -sign * 0.25, 0]), at)[1] == pytest.approx(-sign * 0.25)


def test_the_slow_down_distance_of_the_configuration_counts() -> None:
    wide = Workspace(LIMITS.model_copy(update={"slow_down_mm": 120.0}), MOTION, DEADMAN_S)
    at, down = np.array([0.33, 0, 0.045]), np.array([0, 0, -0.25])
    assert -wide.cap(down, at)[2] == pytest.approx(0.25 * (0.04 - 5e-4) / 0.12)


def test_the_floor_counts_when_it_is_above_the_box() -> None:
    raised = Workspace(LIMITS.model_copy(update={"floor_mm": 50.0}), MOTION, DEADMAN_S)
    assert raised.cap(np.array([0, 0, -0.1]), np.array([0.33, 0, 0.05]))[2] == 0.0


@given(positions, velocities, st.integers(0, 12))
def test_what_is_admitted_brakes_inside_even_after_the_deadman_time(
    position: np.ndarray, velocity: np.ndarray, late: int
) -> None:
    plan = VelocityPlan(velocity, np.zeros(3), np.zeros(3), STOP)
    if not SPACE.admits(position, velocity, plan):
        return
    now = SPACE.excess(position[np.newaxis])[0]
    held = velocity * DEADMAN_S * late / 12
    path = [position + held + plan.at(float(t)).displacement for t in np.linspace(0, 0.12, 40)]
    worst = SPACE.excess(np.array(path)).max(axis=0)
    assert (worst <= np.maximum(now, 0.0) + 2e-4).all()


def test_a_slow_state_is_admitted_and_one_that_cannot_stop_is_not() -> None:
    at, along = np.array([0.33, 0, 0.02]), np.array([0, 0, -1.0])
    for speed, fits in ((0.05, True), (0.2, False)):
        plan = VelocityPlan(speed * along, np.zeros(3), np.zeros(3), STOP)
        assert SPACE.admits(at, speed * along, plan) is fits


def test_far_is_measured_to_the_nearest_bound() -> None:
    at = np.array([0.3, 0.0, 0.055])
    assert SPACE.is_far(at, 0.049)
    assert not SPACE.is_far(at, 0.051)
    assert not SPACE.is_far(np.array([0.3, 0.0, 0.0]), 0.0)


# --- the cone -----------------------------------------------------------------------------------


def offset_of(degrees: float, axis: tuple[float, float, float] = (0, 1, 0)) -> np.ndarray:
    turn = np.radians(degrees) * np.array(axis)
    return CONE.offset(turned(of_rotation(READY), turn))


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
    plan = VelocityPlan(angular, np.zeros(3), np.zeros(3), TURN_STOP)
    if not CONE.admits(offset, angular, plan):
        return
    start = turned(of_rotation(READY), offset)
    bound = max(math.radians(LIMITS.cone_deg), float(np.linalg.norm(offset)))
    for t_s in np.linspace(0, plan.duration_s, 10):
        turn = angular * DEADMAN_S + plan.at(float(t_s)).displacement
        angle = (to_rotation(turned(start, turn)) * READY.inv()).magnitude()
        assert angle <= bound + 1e-4


def test_the_cone_admits_slow_turning_and_refuses_what_cannot_stop() -> None:
    for speed, fits in ((0.05, True), (0.5, False)):
        plan = VelocityPlan(np.array([0, speed, 0]), np.zeros(3), np.zeros(3), TURN_STOP)
        assert CONE.admits(offset_of(33), np.array([0, speed, 0]), plan) is fits
    assert CONE.is_far(offset_of(10), math.radians(24))
    assert not CONE.is_far(offset_of(10), math.radians(26))
