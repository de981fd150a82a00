"""Statistics of episodes put together are those of all their rows."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from tams_app.export.lerobot.statistics import PixelStatistics, merged, statistics_of
from tams_app.video.core.colour import bgr_of, i420_of

pytestmark = pytest.mark.untimed

NUMBERS = st.floats(-1e3, 1e3, allow_subnormal=False, width=32)
COLUMNS = st.integers(1, 20).flatmap(lambda rows: arrays(np.float32, (rows, 2), elements=NUMBERS))


@given(st.lists(COLUMNS, min_size=1, max_size=4))
def test_merged_they_are_those_of_all_rows(columns: list[np.ndarray]) -> None:
    together = merged([statistics_of(column) for column in columns])
    whole = statistics_of(np.concatenate(columns))
    for name in ("min", "max", "mean", "std", "count"):
        assert together[name] == pytest.approx(whole[name], abs=1e-3)
    for name in ("q01", "q50", "q99"):
        assert np.all(together[name] >= whole["min"] - 1e-3)
        assert np.all(together[name] <= whole["max"] + 1e-3)


def test_a_scalar_feature_has_statistics_of_one_number() -> None:
    found = statistics_of(np.array([True, False, False, False]))
    assert found["mean"].tolist() == [0.25]
    assert {value.shape for value in found.values()} == {(1,)}


def test_those_of_pixels_are_by_colour_and_from_0_to_1() -> None:
    random = np.random.default_rng(3)
    images = [
        np.full((48, 64, 3), random.integers(0, 255, 3), np.uint8) for _ in range(5)
    ]  # of one colour each, so that leaving pixels out changes nothing
    pixels = PixelStatistics()
    for image in images:
        pixels.add(i420_of(image), 48, 64)
    found = pixels.result()
    coded = np.stack([bgr_of(i420_of(image), 48, 64) for image in images])
    wanted = coded.reshape(-1, 3)[:, ::-1] / 255  # red first
    assert found["mean"].ravel() == pytest.approx(wanted.mean(axis=0))
    assert found["std"].ravel() == pytest.approx(wanted.std(axis=0))
    assert found["min"].ravel() == pytest.approx(wanted.min(axis=0))
    assert found["max"].ravel() == pytest.approx(wanted.max(axis=0))
    assert found["q50"].ravel() == pytest.approx(np.median(wanted, axis=0))
    assert found["count"].tolist() == [5]
    assert found["mean"].shape == (3, 1, 1)
