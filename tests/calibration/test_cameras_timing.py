"""Rate, drops and clocks of a camera from its timestamps."""

import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.cameras.timing import clock_problem, measure_rate, rate_advice
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed


def grid(fps=30.0, count=300, jitter_ms=0.0, seed=0):
    jitter = np.random.default_rng(seed).normal(0, jitter_ms * NS_PER_MS, count)
    return (NS_PER_S + np.arange(count) * NS_PER_S / fps + jitter).astype(np.int64).tolist()


@given(
    fps=st.floats(10, 60),
    missing=st.sets(st.integers(1, 297), max_size=60),
    seed=st.integers(0, 99),
)
def test_rate_and_drops_are_counted_exactly(fps, missing, seed):
    times = [t for place, t in enumerate(grid(fps, 300, 1.0, seed)) if place not in missing]
    rate = measure_rate(times)
    assert rate.rate_hz == pytest.approx(fps, rel=1e-3)
    assert rate.missed == len(missing)
    assert rate.jitter_ms == pytest.approx(1.0, rel=0.3)


def test_a_slow_camera_drops_and_jitter_each_have_their_sentence():
    assert rate_advice(measure_rate(grid()), 30) == []
    assert "15.00 frames a second instead of 30" in rate_advice(measure_rate(grid(15)), 30)[0]
    kept = [t for place, t in enumerate(grid()) if place % 10]
    assert "of 299 frames are missing" in rate_advice(measure_rate(kept), 30)[0]
    assert "off their time" in rate_advice(measure_rate(grid(jitter_ms=9.0)), 30)[0]


def delivered(times, delay_ms=20.0, spread_ms=8.0, seed=1):
    late = np.random.default_rng(seed).exponential(spread_ms, len(times)) + delay_ms
    return (np.asarray(times) + late * NS_PER_MS).astype(np.int64).tolist()


def test_timestamps_of_the_hosts_clock_are_accepted_however_delivery_spreads():
    for seed in range(20):
        times = grid(seed=seed)
        assert clock_problem(times, delivered(times, seed=seed)) == ""


@pytest.mark.parametrize(("offset_s", "words"), [(1.7e9, "lie ahead"), (-3000, "3000.0 s old")])
def test_another_clock_is_noticed(offset_s, words):
    times = grid()
    other = [t + round(offset_s * NS_PER_S) for t in times]
    assert words in clock_problem(other, delivered(times))


def test_a_clock_that_drifts_is_noticed_and_measured():
    times = grid(count=600)
    drifting = [round(t - 1e-3 * (t - times[0])) for t in times]
    problem = clock_problem(drifting, delivered(times, spread_ms=2.0))
    ppm = float(re.search(r"drift by (-?\d+) ppm", problem)[1])
    assert ppm == pytest.approx(1000, abs=100)
