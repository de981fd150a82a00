"""Grey levels counted once, where numpy would sort them: the same figures."""

from __future__ import annotations

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from hw.sim.operator.vision.blobs import level_counts
from hw.sim.operator.vision.fiducials import percentile
from tams_app.records import Image

pytestmark = pytest.mark.untimed

IMAGES = hnp.arrays(
    np.uint8,
    st.tuples(st.integers(8, 40), st.integers(8, 40)),
    elements=st.one_of(st.sampled_from([0, 64, 255]), st.integers(0, 255)),
)


@given(IMAGES)
def test_levels_are_counted(image: Image) -> None:
    counts = level_counts(image[1:, 2:])
    np.testing.assert_array_equal(counts, np.bincount(image[1:, 2:].ravel(), minlength=256))


@given(IMAGES, st.sampled_from((0.0, 0.05, 0.5, 0.95, 1.0)))
def test_percentiles_are_numpy_s_to_the_last_bit(image: Image, part: float) -> None:
    assert percentile(level_counts(image), part) == np.percentile(image, 100 * part)
