"""The frame from touched points: rotation, scale, its own bound, and what is refused."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import transform

from calibration.frame.fit import turn_deg
from calibration.frame.stroke import RefusedError, StrokeFault
from calibration.frame.touches import Touch, fit_touches
from tams_app.rotation import Rotation
from tests.calibration.frame.synthetic import POINTS, touches

pytestmark = pytest.mark.untimed

TRUTH = transform.Rotation.from_euler("xyz", [80, 10, -95], degrees=True).as_matrix()


def refusal(made):
    with pytest.raises(RefusedError) as caught:
        fit_touches(made)
    return caught.value


@settings(max_examples=50)
@given(st.integers(0, 2**32 - 1), st.floats(0.3, 3.0))
def test_exact_touches_give_rotation_and_scale_exactly(seed, scale):
    truth = transform.Rotation.random(random_state=seed).as_matrix()
    fit = fit_touches(touches(truth, np.random.default_rng(seed), scale=scale))
    assert turn_deg(fit.rotation, truth) < 1e-5
    assert fit.scale == pytest.approx(scale)
    assert fit.error_bound_deg < 1e-4
    assert fit.left_out == ()


@pytest.mark.parametrize(("count", "noise_m"), [(4, 0.002), (5, 0.002), (5, 0.004)])
def test_its_own_bound_holds_as_often_as_it_says(count, noise_m):
    inside, bounds, errors = 0, [], []
    for seed in range(200):
        truth = transform.Rotation.random(random_state=seed).as_matrix()
        made = touches(truth, np.random.default_rng(seed), POINTS[:count], noise_m=noise_m)
        fit = fit_touches(made)
        errors.append(turn_deg(fit.rotation, truth))
        bounds.append(fit.error_bound_deg)
        inside += errors[-1] <= bounds[-1]
    assert inside > 0.9 * 200
    assert np.median(bounds) < 5 * np.median(errors)


def test_four_flat_points_are_enough_for_the_rotation_and_said_to_be_flat():
    flat = np.array([[0.25, 0.1, 0.05], [0.25, -0.1, 0.05], [0.4, -0.1, 0.05], [0.4, 0.1, 0.05]])
    fit = fit_touches(touches(TRUTH, np.random.default_rng(0), flat))
    assert turn_deg(fit.rotation, TRUTH) < 1e-5
    assert fit.is_flat
    assert not fit_touches(touches(TRUTH, np.random.default_rng(0))).is_flat


@pytest.mark.parametrize("wrong", range(5))
def test_a_touch_of_the_wrong_place_is_left_out(wrong):
    made = touches(TRUTH, np.random.default_rng(wrong), noise_m=0.0005)
    made[wrong] = Touch(made[wrong].robot, made[wrong].hand + 0.06, made[wrong].hand_rotation)
    fit = fit_touches(made)
    assert fit.left_out == (wrong,)
    assert turn_deg(fit.rotation, TRUTH) < 1.0
    assert fit.misses_mm[wrong] == pytest.approx(104, abs=8)


@pytest.mark.parametrize(
    ("points", "scale", "reason"),
    [
        (POINTS[:3], 1.0, StrokeFault.MISSING),
        (np.linspace((0.2, 0.0, 0.1), (0.4, 0.1, 0.14), 5), 1.0, StrokeFault.NOT_INDEPENDENT),
        (POINTS, 0.001, StrokeFault.IMPOSSIBLE_SCALE),  # a list in metres
    ],
)
def test_points_that_cannot_give_a_frame_are_refused(points, scale, reason):
    assert refusal(touches(TRUTH, np.random.default_rng(0), points, scale)).reason is reason


def bound_deg(made):
    """Infinite where the touches are refused."""
    try:
        return fit_touches(made).error_bound_deg
    except RefusedError:
        return np.inf


@pytest.mark.parametrize("seed", range(20))
def test_of_only_four_touches_a_wrong_one_makes_the_frame_too_uncertain_to_be_written(seed):
    made = touches(TRUTH, np.random.default_rng(seed), POINTS[:4], noise_m=0.002)
    made[1] = Touch(made[1].robot, made[1].hand + 0.06, made[1].hand_rotation)
    assert bound_deg(made) > 3.0


@pytest.mark.parametrize("noise_m", [0.0, 0.002])
@pytest.mark.parametrize("count", [4, 5])
def test_a_mirrored_list_is_refused_as_such_and_no_touch_blamed(count, noise_m):
    made = touches(
        TRUTH, np.random.default_rng(0), POINTS[[0, 1, 2, 3, 4][-count:]], noise_m=noise_m
    )
    mirrored = [Touch(one.robot * [1, -1, 1], one.hand, one.hand_rotation) for one in made]
    assert refusal(mirrored).reason is StrokeFault.MIRRORED


def test_a_hand_that_turned_between_touches_is_refused():
    made = touches(TRUTH, np.random.default_rng(0))
    turned = Rotation.from_rotvec((np.radians(40), 0, 0))
    made[2] = Touch(made[2].robot, made[2].hand, turned)
    error = refusal(made)
    assert error.reason is StrokeFault.TURNED_HAND
    assert "At touch 3" in str(error)
