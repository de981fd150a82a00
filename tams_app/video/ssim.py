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
_CENTRE = 128  # moments about mid-grey: squares stay small, float32 is exact enough
_WEIGHTS = cv2.getGaussianKernel(2 * RADIUS + 1, _SIGMA, cv2.CV_32F)
_ACROSS, _DOWN = _WEIGHTS.reshape(1, -1), _WEIGHTS.reshape(-1, 1)


def luma_of(image: Image) -> Luma:
    """The 8-bit luma (BT.601) of a BGR image, shape (height, width, 3)."""
    return np.asarray(cv2.cvtColor(image, cv2.COLOR_BGR2GRAY), np.uint8)


@dataclass(frozen=True, slots=True)
class FrameMoments:
    """What every comparison with one image needs of it, float32, shape (height, width).

    `luma` and `mean` count from mid-grey. Weighted by the window are `mean` (μ), `brightness`
    (μ² from black, + C₁/2) and `contrast` (σ² + C₂/2).
    """

    luma: Field
    mean: Field
    brightness: Field
    contrast: Field

    @staticmethod
    def of(luma: Luma) -> FrameMoments:
        """Moments of an 8-bit luma, shape (height, width), both at least 11."""
        if min(luma.shape) <= 2 * RADIUS:
            raise ValueError(f"SSIM needs images of 11x11 pixels or more, got {luma.shape}")
        centred = np.subtract(luma, np.float32(_CENTRE), dtype=np.float32)
        mean = np.asarray(
            cv2.sepFilter2D(luma, cv2.CV_32F, _WEIGHTS, _WEIGHTS, delta=-_CENTRE), np.float32
        )
        square = centred * centred
        contrast = _windowed(square, _C2 / 2)
        contrast -= np.multiply(mean, mean, out=square)
        brightness = np.add(mean, np.float32(_CENTRE), out=square)
        brightness *= brightness
        brightness += np.float32(_C1 / 2)
        return FrameMoments(centred, mean, brightness, contrast)


def ssim(one: FrameMoments, other: FrameMoments) -> float:
    """Mean structural similarity of two images of one size, within 1e-4; 1 if they are equal."""
    if one.luma.shape != other.luma.shape:
        raise ValueError(f"cannot compare {one.luma.shape} with {other.luma.shape} pixels")
    part = one.luma * other.luma
    covariance = _windowed(part, _C2 / 2)  # σμμ' + C₂/2
    covariance -= np.multiply(one.mean, other.mean, out=part)
    np.subtract(one.mean, other.mean, out=part)
    part *= part
    brightness = one.brightness + other.brightness  # μ² + μ'² + C₁
    covariance *= np.subtract(brightness, part, out=part)  # 2μμ' + C₁, by way of (μ − μ')²
    brightness *= np.add(one.contrast, other.contrast, out=part)
    covariance /= brightness
    inside = covariance[RADIUS:-RADIUS, RADIUS:-RADIUS]
    return 2 * float(cv2.mean(inside)[0])


def _windowed(field: Field, added: float) -> Field:
    """The Gaussian-weighted mean around each pixel, and `added`; 15 % sooner than sepFilter2D."""
    across = cv2.filter2D(field, cv2.CV_32F, _ACROSS)
    return np.asarray(cv2.filter2D(across, cv2.CV_32F, _DOWN, delta=added), np.float32)
