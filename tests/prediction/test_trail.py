import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.prediction.forward_model import Trail

pytestmark = pytest.mark.untimed

times = st.lists(st.integers(0, 10_000), min_size=1, max_size=20, unique=True).map(sorted)


@given(times, st.integers(-100, 10_100))
def test_a_trail_is_linear_between_its_samples_and_constant_beyond_them(stamps, t_ns):
    trail = Trail(1 << 40)
    for stamp in stamps:
        trail.add(stamp, np.array([float(stamp) ** 2]))
    expected = np.interp(t_ns, stamps, np.square(stamps, dtype=float))
    assert trail.at(t_ns) == pytest.approx([expected])


@given(times, st.integers(0, 3000))
def test_a_trail_keeps_what_is_asked_for(stamps, kept_ns):
    trail, whole = Trail(kept_ns), Trail(1 << 40)
    for stamp in stamps:
        trail.add(stamp, np.array([float(stamp)]))
        whole.add(stamp, np.array([float(stamp)]))
    for t_ns in range(max(stamps[0], stamps[-1] - kept_ns), stamps[-1] + 1, 97):
        assert trail.at(t_ns) == pytest.approx(whole.at(t_ns))


def test_a_trail_forgets_what_is_older():
    trail = Trail(100)
    for stamp in range(0, 10_000, 10):
        trail.add(stamp, np.zeros(1))
    assert len(trail) <= 12


def test_a_sample_that_is_not_newer_is_left_out():
    trail = Trail(100)
    trail.add(50, np.ones(1))
    trail.add(50, np.zeros(1))
    trail.add(40, np.zeros(1))
    assert len(trail) == 1
    assert trail.newest[1] == pytest.approx([1.0])


def test_a_trail_may_go_on_for_a_while_as_it_went_last():
    trail = Trail(1000)
    trail.add(100, np.array([1.0]))
    assert trail.at(150, ahead_ns=40) == pytest.approx([1.0])  # one sample has no direction
    trail.add(110, np.array([3.0]))
    assert trail.at(115, ahead_ns=40) == pytest.approx([4.0])
    assert trail.at(150, ahead_ns=40) == pytest.approx([11.0])
    assert trail.at(500, ahead_ns=40) == pytest.approx([11.0])
    assert trail.at(500) == pytest.approx([3.0])
    assert trail.at(105, ahead_ns=40) == pytest.approx([2.0])
