"""The frame from strokes: how right it is, and what is said of strokes that are wrong."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from calibration.frame.fit import RefusedError, Stroke, fit_strokes, turn_deg

pytestmark = pytest.mark.untimed

BEHIND = np.array([[0.0, 0.0, -1.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])  # upright
SEEDS = range(120)


def stroke(
    rotation,
    axis,
    random,
    length_m=0.2,
    samples=50,
    noise_m=0.0,
    wrong_deg=0.0,
    bow=0.0,
    sign=1,
):
    """Along the robot's `axis` in a tracking frame that `rotation` takes to the arm's base."""
    wrong = np.radians(wrong_deg) * random.standard_normal(3)
    along = Rotation.from_rotvec(wrong).apply(sign * rotation.T[:, axis])
    aside = np.cross(along, [0.3, -0.5, 0.81])
    aside /= np.linalg.norm(aside)
    way = np.linspace(0.0, 1.0, samples)[:, None]
    points = length_m * (way * along + bow * 4 * way * (1 - way) * aside)
    start = random.uniform(-0.3, 0.3, 3)
    return Stroke(axis, start + points + noise_m * random.standard_normal((samples, 3)))


def strokes(rotation, random, rounds=1, **how):
    return [stroke(rotation, axis, random, **how) for _ in range(rounds) for axis in range(3)]


@st.composite
def rotations(draw):
    parts = [draw(st.floats(-1.0, 1.0)) for _ in range(4)]
    if np.linalg.norm(parts) < 0.1:
        parts = [1.0, 0.0, 0.0, 0.0]
    return Rotation.from_quat(parts).as_matrix()


def errors_and_bounds(**how):
    found = []
    for seed in SEEDS:
        truth = Rotation.random(random_state=seed).as_matrix()
        fit = fit_strokes(strokes(truth, np.random.default_rng(seed), **how))
        found.append((turn_deg(fit.rotation, truth), fit.error_bound_deg))
    return np.array(found).T


def refusal(made):
    """What is said of the strokes."""
    with pytest.raises(RefusedError) as caught:
        fit_strokes(made)
    return str(caught.value)


def test_strokes_of_200_mm_and_50_samples_with_5_mm_noise_give_under_1_degree():
    """A sample is 5 mm from its true place (RMS distance): 2.9 mm along each axis."""
    errors, _ = errors_and_bounds(noise_m=0.005 / np.sqrt(3))
    assert np.percentile(errors, 98) < 1.0
    assert np.sqrt((errors**2).mean()) < 0.55
    errors, _ = errors_and_bounds(noise_m=0.005 / np.sqrt(3), rounds=2)
    assert errors.max() < 1.0


@settings(max_examples=15)
@given(rotations(), st.integers(0, 2**32 - 1))
def test_any_rotation_is_found_to_within_1_degree(truth, seed):
    random = np.random.default_rng(seed)
    fit = fit_strokes(strokes(truth, random, rounds=2, length_m=0.3, samples=120, noise_m=0.005))
    assert turn_deg(fit.rotation, truth) < 1.0
    assert np.linalg.det(fit.rotation) == pytest.approx(1.0)
    assert fit.residual_mm == pytest.approx(5.0 * np.sqrt(2), rel=0.15)  # two axes across


@settings(max_examples=15)
@given(rotations(), st.integers(0, 2**32 - 1))
def test_turning_the_tracking_frame_turns_the_result_and_nothing_else(turn, seed):
    random = np.random.default_rng(seed)
    made = strokes(BEHIND, random, rounds=2, noise_m=0.002)
    turned = [Stroke(one.axis, one.positions @ turn.T) for one in made]
    before, after = fit_strokes(made), fit_strokes(turned)
    assert turn_deg(after.rotation @ turn, before.rotation) < 1e-6
    assert after.error_bound_deg == pytest.approx(before.error_bound_deg)


@pytest.mark.parametrize("rounds", [1, 2])
def test_the_error_is_within_its_bound_as_often_as_it_says(rounds):
    errors, bounds = errors_and_bounds(rounds=rounds, wrong_deg=1.0, noise_m=0.001, length_m=0.3)
    assert (errors <= bounds).mean() > 0.9
    assert (errors <= 0.25 * bounds).mean() < 0.6  # and is no idle number


def test_jumps_of_the_tracking_do_not_count():
    random = np.random.default_rng(1)
    made = strokes(BEHIND, random, noise_m=0.001)
    for one in made:
        one.positions[random.integers(0, 50, 6)] += random.normal(0, 0.3, (6, 3))
    assert turn_deg(fit_strokes(made).rotation, BEHIND) < 0.5


LEAN_25 = BEHIND @ Rotation.from_rotvec(np.radians(25) * BEHIND[0]).as_matrix()


@pytest.mark.parametrize(
    ("truth", "sign", "remark"),
    [(LEAN_25, 1, "was 25° from the others"), (BEHIND, -1, "went the other way")],
)
def test_a_stroke_that_went_astray_is_left_out_and_named(truth, sign, remark):
    random = np.random.default_rng(2)
    made = strokes(BEHIND, random, rounds=2, noise_m=0.001)
    made[4] = stroke(truth, 1, random, noise_m=0.001, sign=sign)
    fit = fit_strokes(made)
    assert turn_deg(fit.rotation, BEHIND) < 0.5
    assert [one.used for one in fit.strokes] == [True, True, True, True, False, True]
    assert fit.left_out == (f"one +y stroke {remark} and is left out",)


@pytest.mark.parametrize(
    ("went", "signs"),
    [
        ((0, 1, 2), (-1, 1, 1)),
        ((0, 1, 2), (1, 1, -1)),
        ((1, 0, 2), (1, 1, 1)),
        ((0, 2, 1), (1, 1, 1)),
    ],
)
def test_a_reversed_stroke_and_swapped_axes_make_a_mirrored_frame(went, signs):
    random = np.random.default_rng(5)
    made = [stroke(BEHIND, axis, random, sign=sign) for axis, sign in zip(went, signs, strict=True)]
    told = refusal([Stroke(n, one.positions) for n, one in enumerate(made)])
    assert "a mirrored frame" in told
    assert "make them all again, each as prompted" in told


@pytest.mark.parametrize(
    ("sign", "words"), [(1, "nearly the same way"), (-1, "nearly opposite ways")]
)
def test_strokes_that_are_not_independent_are_named(sign, words):
    random = np.random.default_rng(6)
    made = strokes(BEHIND, random)
    made[1] = Stroke(1, stroke(BEHIND, 0, random, sign=sign).positions)
    assert f"The +x and +y strokes went {words}" in refusal(made)


def test_strokes_that_are_far_from_square_are_named():
    random = np.random.default_rng(7)
    made = strokes(BEHIND, random)
    lean = Rotation.from_rotvec(np.radians(35) * BEHIND[0]).as_matrix()
    made[1] = stroke(BEHIND @ lean, 1, random)
    assert "The +y and +z strokes are 35° from a right angle" in refusal(made)


@pytest.mark.parametrize(
    ("how", "words"),
    [
        ({"length_m": 0.12}, "was 120 mm long: make it at least 200 mm"),
        ({"samples": 30}, "has 30 samples of the 50 it takes"),
        ({"samples": 2}, "has 2 samples"),
        ({"bow": 0.15}, "is bent by 30 mm over 200 mm"),
        ({"noise_m": 0.02, "samples": 200, "length_m": 0.4}, "scatters by 2"),
    ],
)
def test_a_bad_stroke_is_refused_with_what_to_do(how, words):
    assert words in refusal(strokes(BEHIND, np.random.default_rng(9), **how))


def test_a_stroke_there_and_back_is_refused():
    made = strokes(BEHIND, np.random.default_rng(10))
    one = made[2].positions
    made[2] = Stroke(2, np.concatenate((one, one[::-1][:40])))
    assert "The +z stroke went back" in refusal(made)
