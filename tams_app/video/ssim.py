"""The structural similarity of two images (Wang et al. 2004), one of them often compared again.

11×11 Gaussian window with σ 1.5, K₁ .01, K₂ .03, data range 255, population covariance, mean over
the windows that lie inside the image: scikit-image's structural_similarity(a, b,
gaussian_weights=True, sigma=1.5, use_sample_covariance=False, data_range=255).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TypeAlias

import cv2
import numpy as np
from numpy.typing import NDArray

from tams_app.records import Image

Field: TypeAlias = NDArray[np.float32]
Luma: TypeAlias = NDArray[np.uint8]

RADIUS = 5  # of the window [pixels]: 3.5 σ
_SIGMA = 1.5
_C1 = (0.01 * 255) ** 2
_C2 = (0.03 * 255) ** 2
_CENTRE = 128.0  # moments about mid-grey: squares stay small, float32 is exact enough
_WEIGHTS = cv2.getGaussianKernel(2 * RADIUS + 1, _SIGMA, cv2.CV_32F)


def luma_of(image: Image) -> Luma:
    """The 8-bit luma (BT.601) of a BGR image, shape (height, width, 3)."""
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)


@dataclass(frozen=True, slots=True)
class FrameMoments:
    """What every comparison with one image needs of it, float32, shape (height, width).

    `luma` and `mean` count from mid-grey; `mean` and `variance` are weighted by the window.
    """

    luma: Field
    mean: Field
    variance: Field

    @staticmethod
    def of(luma: Luma) -> FrameMoments:
        """Moments of an 8-bit luma, shape (height, width), both at least 11."""
        if min(luma.shape) <= 2 * RADIUS:
            raise ValueError(f"SSIM needs images of 11x11 pixels or more, got {luma.shape}")
        centred = luma.astype(np.float32)
        centred -= _CENTRE
        mean = _windowed(centred)
        variance = _windowed(centred * centred)
        variance -= mean * mean
        return FrameMoments(centred, mean, variance)


def ssim(one: FrameMoments, other: FrameMoments) -> float:
    """Mean structural similarity of two images of one size, within 1e-4; 1 if they are equal."""
    if one.luma.shape != other.luma.shape:
        raise ValueError(f"cannot compare {one.luma.shape} with {other.luma.shape} pixels")
    product = one.mean * other.mean
    covariance = _windowed(one.luma * other.luma)
    covariance -= product
    # (μ + c)(μ' + c) = μμ' + c(μ + μ') + c², and the sum of the squares by way of (μ − μ')²
    product += _CENTRE * (one.mean + other.mean)
    product += _CENTRE**2
    difference = one.mean - other.mean
    difference *= difference
    product *= 2
    luminance = product + _C1
    difference += luminance
    covariance *= 2
    covariance += _C2
    contrast = one.variance + other.variance
    contrast += _C2
    luminance *= covariance
    difference *= contrast
    luminance /= difference
    inside = luminance[RADIUS:-RADIUS, RADIUS:-RADIUS]
    return float(cv2.mean(inside)[0])


def _windowed(field: Field) -> Field:
    """The Gaussian-weighted mean around each pixel."""
    return np.asarray(cv2.sepFilter2D(field, cv2.CV_32F, _WEIGHTS, _WEIGHTS), np.float32)
