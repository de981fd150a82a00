"""The structural similarity of two images (Wang et al. 2004), one of them often compared again.

11×11 Gaussian window with σ 1.5, K₁ .01, K₂ .03, data range 255, population covariance, mean over
the windows that lie inside the image: scikit-image's structural_similarity(a, b,
gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=255).
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from tams_app.records import Image, TaskRegion

Field: TypeAlias = NDArray[np.float32]
Luma: TypeAlias = NDArray[np.uint8]

RADIUS = 5  # of the window [pixels]: 3.5 σ
_SIGMA = 1.5
_C1 = (0.01 * 255) ** 2
_C2 = (0.03 * 255) ** 2
_INSIDE = (slice(RADIUS, -RADIUS), slice(RADIUS, -RADIUS))
_WEIGHTS = cv2.getGaussianKernel(2 * RADIUS + 1, _SIGMA, cv2.CV_32F)
_ACROSS, _DOWN = _WEIGHTS.reshape(1, -1), _WEIGHTS.reshape(-1, 1)


def luma_of(image: Image) -> Luma:
    """The 8-bit luma (BT.601) of a BGR image, shape (height, width, 3)."""
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)


@dataclass(frozen=True, slots=True)
class FrameMoments:
    """The moments of one image for all comparisons with it, shape (height, width).

    Weighted by the window are `mean` (μ) and `contrast` (σ² + C₂/2).
    """

    luma: Luma
    mean: Field
    contrast: Field

    @staticmethod
    def of(luma: Luma) -> FrameMoments:
        """Moments of an 8-bit luma, shape (height, width), both at least 11."""
        if min(luma.shape) <= 2 * RADIUS:
            raise ValueError(f"SSIM needs images of 11x11 pixels or more, got {luma.shape}")
        mean = np.asarray(cv2.sepFilter2D(luma, cv2.CV_32F, _WEIGHTS, _WEIGHTS), np.float32)
        contrast = _windowed_product(luma, luma, _C2 / 2)
        contrast -= mean * mean
        return FrameMoments(luma, mean, contrast)


@dataclass(frozen=True, slots=True)
class Similarity:
    """Mean structural similarity of two images: all of it, and of the task's region in it.

    task: None where there is no region, or nothing of it inside the image.
    """

    whole: float
    task: float | None = None


def ssim(one: FrameMoments, other: FrameMoments) -> float:
    """Mean structural similarity of two images of one size, within 1e-4; 1 if they are equal."""
    return similarity(one, other).whole


def similarity(
    one: FrameMoments, other: FrameMoments, region: TaskRegion | None = None
) -> Similarity:
    """That of two images of one size; in `region` over the windows with their middle in it.

    (2μμ' + C₁) / (μ² + μ'² + C₁), times (2cov + C₂) / (σ² + σ'² + C₂), each computed as halves.
    """
    if one.luma.shape != other.luma.shape:
        raise ValueError(f"cannot compare {one.luma.shape} with {other.luma.shape} pixels")
    means = one.mean * other.mean
    contrast = _windowed_product(one.luma, other.luma, _C2 / 2)
    contrast -= means  # cov + C₂/2
    contrast /= one.contrast + other.contrast
    means += np.float32(_C1 / 2)  # μμ' + C₁/2
    brightness = one.mean * one.mean
    cv2.accumulateSquare(other.mean, brightness)
    brightness += np.float32(_C1)
    means /= brightness
    inside = means[_INSIDE]
    rows = np.einsum("ij,ij->i", inside, contrast[_INSIDE])
    whole = 4 * float(rows.sum(dtype=float)) / inside.size
    return Similarity(whole, None if region is None else _within(region, means, contrast))


def _within(region: TaskRegion, means: Field, contrast: Field) -> float | None:
    """The mean over the region of what `similarity` takes the mean of; None: it is not inside."""
    height, width = means.shape
    left, right = _span(region.x_px, region.radius_px, width)
    top, bottom = _span(region.y_px, region.radius_px, height)
    y, x = np.ogrid[top:bottom, left:right]
    chosen = (x - region.x_px) ** 2 + (y - region.y_px) ** 2 <= region.radius_px**2
    count = int(np.count_nonzero(chosen))
    if not count:
        return None
    box = slice(top, bottom), slice(left, right)
    return 4 * float((means[box] * contrast[box])[chosen].sum(dtype=float)) / count


def _span(middle_px: float, radius_px: float, size_px: int) -> tuple[int, int]:
    """From and up to which pixel the region and the windows inside the image reach, one way."""
    first = max(RADIUS, math.ceil(middle_px - radius_px))
    return first, max(first, min(size_px - RADIUS, math.floor(middle_px + radius_px) + 1))


def _windowed_product(one: Luma, other: Luma, added: float) -> Field:
    """The Gaussian-weighted mean of a product around each pixel, and `added`."""
    product = np.zeros(one.shape, np.float32)
    cv2.accumulateProduct(one, other, product)  # sooner than to convert, then to multiply
    across = cv2.filter2D(product, cv2.CV_32F, _ACROSS)  # two passes: sooner than sepFilter2D
    return np.asarray(cv2.filter2D(across, cv2.CV_32F, _DOWN, delta=added), np.float32)
