import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.sim.operator.belief_state import (
    BLOCK,
    BLOCK_Z,
    CONTAINER,
    TOOL,
    GaussianEstimate,
    motion_noise,
)

pytestmark = pytest.mark.untimed

SOUGHT, OTHERS = 3, 2
SIZE = SOUGHT + OTHERS


def _drawn(seed):
    """An estimate of correlated numbers, and a measurement of them."""
    random = np.random.default_rng(seed)
    estimate = GaussianEstimate(random.normal(size=SIZE), np.ones(SIZE), SOUGHT)
    spread = random.normal(size=(SIZE, SIZE))
    estimate.covariance = spread @ spread.T + 0.1 * np.eye(SIZE)
    count = int(random.integers(1, 4))
    rows, noise = random.normal(size=(count, SIZE)), random.normal(size=(count, count))
    return estimate, rows, random.normal(size=count), noise @ noise.T + 0.1 * np.eye(count)


seeds = st.integers(0, 2**32)


@given(seeds)
def test_a_measurement_makes_what_is_sought_more_certain_and_leaves_the_rest(seed):
    estimate, rows, gaps, noise = _drawn(seed)
    state, before = estimate.state.copy(), estimate.covariance.copy()
    estimate.update(rows, gaps, noise)
    gained = before - estimate.covariance
    assert np.linalg.eigvalsh(gained[:SOUGHT, :SOUGHT]).min() > -1e-8 * np.abs(before).max()
    assert np.linalg.eigvalsh(estimate.covariance).min() > -1e-8
    assert (estimate.state[SOUGHT:] == state[SOUGHT:]).all()
    assert estimate.covariance[SOUGHT:, SOUGHT:] == pytest.approx(before[SOUGHT:, SOUGHT:])


def test_errors_of_several_draws_are_as_large_as_the_covariance_says():
    random = np.random.default_rng(4)
    normalised = []
    for _ in range(300):
        true, error = random.normal(0.0, 10.0), random.normal()
        estimate = GaussianEstimate(np.zeros(2), np.array([10.0, 1.0]), 1)
        for _ in range(8):
            seen = true + 2.0 * error + random.normal(0.0, 0.5)
            gap = np.array([seen - estimate.state[0]])
            estimate.update(np.array([[1.0, 2.0]]), gap, np.array([[0.25]]))
        normalised.append((estimate.state[0] - true) / np.sqrt(estimate.covariance[0, 0]))
    assert np.std(normalised) == pytest.approx(1.0, abs=0.12)


def test_what_is_forgotten_is_as_uncertain_as_told_and_tied_to_nothing():
    estimate, *_ = _drawn(1)
    estimate.forget(slice(1, 3), 0.5)
    assert estimate.covariance[1:3, 1:3] == pytest.approx(np.eye(2) * 0.25)
    assert not estimate.covariance[1:3, [0, 3, 4]].any()


steps = st.tuples(*[st.floats(-0.05, 0.05)] * 3).map(np.array)
REST = np.zeros(3)


@given(steps, steps, st.floats(0.0, 1.0), st.floats(0.0, 1.0), st.booleans())
def test_noise_is_a_covariance_and_grows_with_time_and_motion(moved, turned, seconds, along, near):
    noise = motion_noise(moved, turned, seconds, along, near)
    assert noise == pytest.approx(noise.T)
    assert np.linalg.eigvalsh(noise).min() > -1e-15
    more = motion_noise(2.0 * moved, 2.0 * turned, 2.0 * seconds, along, near)
    assert (np.diag(more) >= np.diag(noise)).all()


def test_what_is_carried_is_as_uncertain_as_the_tool_and_together_with_it():
    noise = motion_noise(np.array([0.02, 0.0, 0.0]), REST, 0.0, 1.0, near=True)
    gap = noise[TOOL, TOOL] + noise[BLOCK, BLOCK] - 2.0 * noise[TOOL, BLOCK]
    assert noise[BLOCK_Z, BLOCK_Z] > noise[2, 2]
    assert gap[0, 0] < 1.5 * noise[0, 0]


def test_what_is_left_alone_is_untouched_by_the_tool_s_motion():
    noise = motion_noise(np.array([0.02, 0.0, 0.0]), REST, 0.0, 0.0, near=False)
    assert not noise[BLOCK, BLOCK].any()
    assert not noise[CONTAINER, CONTAINER].any()
