import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from hw.sim.operator.belief_state import BLOCK, BLOCK_Z, CONTAINER, TOOL, motion_noise

pytestmark = pytest.mark.untimed

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
