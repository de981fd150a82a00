"""SSIM: equal to scikit-image's on pictures."""

from __future__ import annotations

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from skimage.metrics import structural_similarity

from tams_app.records import TaskRegion
from tams_app.video.core.ssim import RADIUS, FrameMoments, Luma, luma_of, similarity, ssim
from tests.video.scenes import image

pytestmark = pytest.mark.untimed


SCENE = luma_of(image(0))


def of(one: Luma, other: Luma) -> float:
    return ssim(FrameMoments.of(one), FrameMoments.of(other))


def reference(one: Luma, other: Luma) -> float:
    return float(
        structural_similarity(
            one, other, gaussian_weights=True, sigma=1.5, use_sample_covariance=False,
            data_range=255,
        )
    )  # fmt: skip


def compressed(luma: Luma) -> Luma:
    _, data = cv2.imencode(".jpg", luma, [cv2.IMWRITE_JPEG_QUALITY, 8])
    return np.asarray(cv2.imdecode(data, cv2.IMREAD_GRAYSCALE), np.uint8)


@settings(deadline=None, max_examples=60)
@given(
    hnp.arrays(
        np.uint8,
        st.tuples(st.just(2), st.integers(11, 40), st.integers(11, 40)),
        elements=st.one_of(st.sampled_from([0, 1, 254, 255]), st.integers(0, 255)),
    )
)
def test_it_is_symmetric_bounded_and_equals_scikit_image_on_anything(pair: Luma) -> None:
    one, other = pair
    assert -1 - 1e-4 <= of(one, other) <= 1 + 1e-4
    assert of(one, other) == pytest.approx(of(other, one), abs=1e-6)
    assert of(one, other) == pytest.approx(reference(one, other), abs=1e-4)


@given(
    x_px=st.floats(-60, 700),
    y_px=st.floats(-60, 540),
    radius_px=st.floats(3, 300),
)
@settings(max_examples=25, deadline=None)
def test_a_region_has_the_mean_over_the_windows_with_their_middle_in_it(
    x_px: float, y_px: float, radius_px: float
) -> None:
    luma, other = SCENE, compressed(SCENE)
    whole, every = structural_similarity(
        luma, other, gaussian_weights=True, sigma=1.5, use_sample_covariance=False,
        data_range=255, full=True,
    )  # fmt: skip
    y, x = np.mgrid[: luma.shape[0], : luma.shape[1]]
    chosen = (x - x_px) ** 2 + (y - y_px) ** 2 <= radius_px**2
    inside = np.zeros_like(chosen)
    inside[RADIUS:-RADIUS, RADIUS:-RADIUS] = True
    expected = every[chosen & inside]
    found = similarity(
        FrameMoments.of(luma), FrameMoments.of(other), TaskRegion(x_px, y_px, radius_px)
    )
    assert found.whole == pytest.approx(whole, abs=2e-5)
    if len(expected):
        assert found.task == pytest.approx(expected.mean(), abs=1e-4)
    else:
        assert found.task is None


def test_damage_outside_the_region_lowers_the_whole_alone() -> None:
    damaged = SCENE.copy()
    damaged[:100, :100] = 0
    moments = FrameMoments.of(SCENE), FrameMoments.of(damaged)
    away, there = TaskRegion(400.0, 300.0, 60.0), TaskRegion(50.0, 50.0, 40.0)
    assert similarity(*moments, away).task == pytest.approx(1.0, abs=1e-6)
    assert similarity(*moments).task is None
    found = similarity(*moments, there)
    assert found.task < found.whole < 1.0


def test_luma_is_that_of_bt_601() -> None:
    colours = np.array([[[255, 0, 0], [0, 255, 0], [0, 0, 255], [255, 255, 255]]], np.uint8)
    assert luma_of(colours).tolist() == [[29, 150, 76, 255]]


def test_images_without_a_whole_window_or_of_other_sizes_are_refused() -> None:
    small, large = np.zeros((11, 11), np.uint8), np.zeros((11, 12), np.uint8)
    assert of(small, small) == pytest.approx(1.0)
    with pytest.raises(ValueError, match="11x11"):
        FrameMoments.of(np.zeros((10, 40), np.uint8))
    with pytest.raises(ValueError, match=r"\(11, 11\) with \(11, 12\)"):
        of(small, large)
