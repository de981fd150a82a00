"""How sharp an image is, whatever it shows and however much light there is."""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from tams_app.records import Image

_FINE_PX, _COARSE_PX = 1.0, 2.5  # Gaussian scales at which gradients are compared
_LARGEST_BLUR_PX = 12.0
_FINEST_PX = 0.5  # what the pixels themselves do
_LEAST_CONTRAST = 6.0  # grey levels, standard deviation
SHARP_BELOW_PX = 1.5
SOFT_FROM_PX = 2.5


@dataclass(frozen=True, slots=True)
class Sharpness:
    """Of one image."""

    blur_px: float  # Gaussian radius by which its edges are washed out; nan if there are none
    tenengrad: float  # gradient energy over contrast, noise taken off [1/px²]: to turn a ring by
    contrast: float  # standard deviation of its grey levels
    noise: float  # standard deviation of its noise, grey levels

    @property
    def measurable(self) -> bool:
        """Whether there is anything in the image to focus on."""
        return not math.isnan(self.blur_px)


def sharpness(image: Image) -> Sharpness:
    """Measure one BGR image.

    A step edge washed out by σ and smoothed by s has gradient energy ∝ 1/√(σ²+s²), so two
    smoothings tell σ, and neither contrast nor the number of edges matters. White noise adds
    σn²/(4π s⁴) to that energy, which is taken off (the gradient of a Gaussian, squared and
    integrated); σn by Immerkær's mask (Computer Vision and Image Understanding 64, 1996).
    """
    grey = cv2.cvtColor(image, cv2.COLOR_BGR2GRAY).astype(np.float64)
    noise, contrast = _noise(grey), float(grey.std())
    fine = _gradient_energy(grey, _FINE_PX, noise)
    coarse = _gradient_energy(grey, _COARSE_PX, noise)
    variance = max(contrast**2 - noise**2, 1e-9)
    floor = 0.02 * variance * 1e-2  # less gradient than that is a blank wall's
    if contrast < max(_LEAST_CONTRAST, 1.5 * noise) or coarse < floor:
        return Sharpness(math.nan, fine / variance, contrast, noise)
    return Sharpness(_blur(fine / coarse), fine / variance, contrast, noise)


def blur_words(measured: Sharpness) -> str:
    """How wide the edges are; below half a pixel there is nothing to tell."""
    if not measured.measurable:
        return "no edges"
    if measured.blur_px <= _FINEST_PX:
        return f"edges {_FINEST_PX} px wide or less"
    return f"edges {measured.blur_px:.1f} px wide"


def focus_advice(measured: Sharpness) -> str:
    """What to do about it, "" if nothing."""
    if not measured.measurable:
        return "there is nothing to focus on: point it at something with edges"
    if measured.blur_px >= SOFT_FROM_PX:
        return f"out of focus ({blur_words(measured)}): turn the ring, clean the lens"
    if measured.blur_px > SHARP_BELOW_PX:
        return f"a little soft ({blur_words(measured)}): turn the ring"
    return ""


def _blur(ratio: float) -> float:
    """σ [px] from the ratio of the fine to the coarse gradient energy, 1 to coarse/fine scale."""
    most = _COARSE_PX / _FINE_PX
    if ratio >= most:
        return 0.0
    if ratio <= 1.0:
        return _LARGEST_BLUR_PX
    squared = (_COARSE_PX**2 - ratio**2 * _FINE_PX**2) / (ratio**2 - 1.0)
    return min(math.sqrt(max(squared, 0.0)), _LARGEST_BLUR_PX)


def _gradient_energy(grey: NDArray[np.float64], scale_px: float, noise: float) -> float:
    smooth = cv2.GaussianBlur(grey, (0, 0), scale_px)
    across = (smooth[1:-1, 2:] - smooth[1:-1, :-2]) / 2
    down = (smooth[2:, 1:-1] - smooth[:-2, 1:-1]) / 2
    energy = float(np.mean(across**2 + down**2))
    return max(energy - noise**2 / (4 * math.pi * scale_px**4), 1e-12)


_IMMERKAER = np.array([[1, -2, 1], [-2, 4, -2], [1, -2, 1]], np.float64)


def _noise(grey: NDArray[np.float64]) -> float:
    """σn; the median instead of the mean of |response|, so that edges do not count as noise."""
    response = cv2.filter2D(grey, cv2.CV_64F, _IMMERKAER)[1:-1, 1:-1]
    return float(np.median(np.abs(response))) * 1.4826 / 6.0
