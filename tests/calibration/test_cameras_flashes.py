"""The latency that a flashing screen tells, with its error."""

import numpy as np
import pytest

from calibration.cameras.flashes import Flashes, camera_latency, switchings
from tams_app.units import NS_PER_MS, NS_PER_S

pytestmark = pytest.mark.untimed


def filmed(latency_ms, seed, exposure_ms=12.0, gamma=2.2, seconds=20.0, fps=30.0, flicker=0.02):
    """Brightness and time stamps of a camera; its stamps come `latency_ms` after mid-exposure."""
    random = np.random.default_rng(seed)
    flashes = Flashes.beginning(5 * NS_PER_S)
    begin_ns = flashes.start_ns + round(random.uniform(0, 1) * NS_PER_S)
    starts_ns = begin_ns + (np.arange(round(seconds * fps)) * NS_PER_S / fps).astype(np.int64)
    exposure_ns = round(exposure_ms * NS_PER_MS)
    shares = [flashes.lit_share(int(t), int(t) + exposure_ns) for t in starts_ns]
    levels = 30 + 150 * np.array(shares) ** (1 / gamma)
    levels *= 1 + random.normal(0, flicker, len(levels))
    stamps = starts_ns + exposure_ns // 2 + round(latency_ms * NS_PER_MS)
    return levels.tolist(), stamps.tolist(), flashes


@pytest.mark.parametrize(("latency_ms", "exposure_ms"), [(0.0, 2.0), (41.0, 12.0), (120.0, 30.0)])
def test_a_known_latency_is_recovered_within_its_stated_error(latency_ms, exposure_ms):
    errors = []
    for seed in range(12):
        found = camera_latency(*filmed(latency_ms, seed, exposure_ms))
        assert found.flashes > 20
        assert found.error_ms < 3.0
        errors.append((found.ms - latency_ms) / found.error_ms)
    assert np.abs(errors).max() < 3.0
    assert np.abs(np.mean(errors)) < 1.0


def test_a_light_that_never_changes_too_few_flashes_and_another_clock_are_refused():
    levels, stamps, flashes = filmed(20.0, 1)
    flat = [100.0 + 0.5 * (n % 2) for n in range(len(levels))]
    assert switchings(flat, stamps) == []
    elsewhere = [stamp - 3600 * NS_PER_S for stamp in stamps]
    for seen in (
        (flat, stamps, flashes),
        (levels, elsewhere, flashes),
        filmed(20.0, 1, seconds=4.0),
    ):
        with pytest.raises(ValueError, match="flashes were seen, 12 are needed"):
            camera_latency(*seen)


def test_a_lamp_switched_in_between_does_not_shift_the_result():
    levels, stamps, flashes = filmed(30.0, 2)
    for start in (100, 300):
        levels[start : start + 4] = [180.0 - level + 30 for level in levels[start : start + 4]]
    assert camera_latency(levels, stamps, flashes).ms == pytest.approx(30.0, abs=6.0)
