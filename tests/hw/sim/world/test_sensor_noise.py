from __future__ import annotations

import numpy as np
import pytest

from hw.sim.viewpoints import HEIGHT_PX, WIDTH_PX
from hw.sim.world.camera_images import NOISE_SIGMA, SensorNoise
from tams_app.records import Image

pytestmark = pytest.mark.untimed


def grey(value: int = 120) -> Image:
    return np.full((HEIGHT_PX, WIDTH_PX, 3), value, np.uint8)


def test_noise_repeats_for_a_frame_and_differs_between_frames_views_and_seeds() -> None:
    def noisy(seed: int, view: str, index: int) -> Image:
        return SensorNoise(seed, view).apply(grey(), index)

    reference = noisy(1, "gt", 5)
    assert np.array_equal(reference, noisy(1, "gt", 5))
    for other in (noisy(1, "gt", 6), noisy(1, "gs", 5), noisy(2, "gt", 5)):
        assert not np.array_equal(reference, other)


def test_noise_has_its_strength_and_no_bias() -> None:
    noisy = SensorNoise(1, "gt").apply(grey(), 0).astype(float)
    assert noisy.std() == pytest.approx(NOISE_SIGMA, rel=0.1)
    assert noisy.mean() == pytest.approx(120, abs=0.3)


def test_noise_never_wraps_around() -> None:
    assert SensorNoise(1, "gt").apply(grey(255), 0).min() > 200
    assert SensorNoise(1, "gt").apply(grey(0), 0).max() < 55
