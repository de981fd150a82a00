"""Rate, drops and clocks of a camera from its timestamps."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.cameras.common_event import (
    offsets_from_latencies,
    offsets_from_switchings,
    switchings,
)
from calibration.cameras.timing import check_clock, measure_rate, rate_advice
from tams_app.runtime.clock import NS_PER_MS, NS_PER_S

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
        check = check_clock(times, delivered(times, seed=seed))
        assert check.problem == ""
        assert 20 <= check.youngest_ms < 21


@pytest.mark.parametrize(("offset_s", "words"), [(1.7e9, "lie ahead"), (-3000, "3000.0 s old")])
def test_another_clock_is_noticed(offset_s, words):
    times = grid()
    other = [t + round(offset_s * NS_PER_S) for t in times]
    assert words in check_clock(other, delivered(times)).problem


def test_a_clock_that_drifts_is_noticed_and_measured():
    times = grid(count=600)
    drifting = [round(t - 1e-3 * (t - times[0])) for t in times]
    check = check_clock(drifting, delivered(times, spread_ms=2.0))
    assert check.drift_ppm == pytest.approx(1000, abs=100)
    assert "drift by" in check.problem


# --- what all of them saw -----------------------------------------------------------------------


def light_seen(offset_ms, seed, switched_s, exposure_ms=20.0, flicker=0.03):
    """Brightness and capture times of a camera whose timestamps come `offset_ms` late."""
    random = np.random.default_rng(seed)
    starts_s = random.uniform(0, 1 / 30) + np.arange(600) / 30
    fine = np.linspace(0, exposure_ms / 1000, 40)
    on = np.searchsorted(switched_s, starts_s[:, None] + fine) % 2
    levels = 30 + 100 * on.mean(axis=1) * (1 + random.normal(0, flicker, len(starts_s)))
    ends_s = starts_s + exposure_ms / 1000 + offset_ms / 1000
    return levels.tolist(), (ends_s * NS_PER_S).astype(np.int64).tolist()


def test_switching_a_light_tells_how_far_two_cameras_are_apart():
    errors = []
    for seed in range(12):
        switched = np.cumsum(np.random.default_rng(seed).uniform(0.8, 1.6, 12))
        seen = {
            "gt": switchings(*light_seen(0.0, seed, switched)),
            "gs": switchings(*light_seen(27.0, seed + 50, switched)),
        }
        assert len(seen["gt"]) == 12
        offset = offsets_from_switchings(seen, "gt")["gs"]
        assert offset.events == 12
        errors.append((offset.ms - 27.0) / offset.error_ms)
    assert np.abs(errors).max() < 3.0
    assert np.abs(np.mean(errors)) < 1.0


def test_too_few_switchings_are_refused():
    switched = np.array([1.0, 2.0])
    seen = {name: switchings(*light_seen(0.0, 1, switched)) for name in ("gt", "gs")}
    with pytest.raises(ValueError, match="saw 2 switchings together; 5 are needed"):
        offsets_from_switchings(seen, "gt")


def test_a_light_that_nobody_switched_is_no_event():
    levels, times = light_seen(0.0, 1, np.array([1e9]))
    assert switchings(levels, times) == []


def test_readings_of_one_screen_tell_the_offset_with_its_error():
    random = np.random.default_rng(3)
    samples = {
        "gt": random.uniform(-8, 8, 100) + 30,
        "gs": random.uniform(-8, 8, 100) + 41,
    }
    offset = offsets_from_latencies(samples, "gt", 16.7)["gs"]
    assert abs(offset.ms - 11) < offset.error_ms
    assert offset.error_ms == pytest.approx(16.7 / 6**0.5)
