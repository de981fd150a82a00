"""Whether an image is too bright, too dark, smeared by motion, or beaten by a lamp."""

from __future__ import annotations

import math
from collections.abc import Sequence
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
    smoothings give σ, and neither contrast nor the number of edges matters. White noise adds
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
    """How wide the edges are; below half a pixel nothing can be determined."""
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


_WHITE, _BLACK = 253, 2  # grey levels from and up to which detail is lost
_CLIPPED = 0.02  # share of the pixels that may be
_DARK, _BRIGHT = 60.0, 190.0  # mean grey levels
_FLICKER = 0.02  # of the brightness
_SWEEP_S = 2.0  # in which a thing crosses the image: 320 px/s at 640, 250 mm/s seen from 0.8 m
_SMEAR_PX = 3.0
_FEWEST_FOR_FLICKER = 30  # images
_BANDS = 24  # of rows
_LIT_GREY = 8


@dataclass(frozen=True, slots=True)
class Exposure:
    """Of one camera; shares 0 to 1."""

    mean_grey: float
    too_bright: float  # share of pixels at the top
    too_dark: float  # share at the bottom
    flicker: float | None  # amplitude over brightness; None: too few images


def measure_exposure(images: Sequence[Image]) -> Exposure:
    """From images, BGR, of one camera at its full rate; at least one."""
    greys = [np.asarray(cv2.cvtColor(one, cv2.COLOR_BGR2GRAY), np.uint8) for one in images]
    last = greys[-1]
    return Exposure(
        mean_grey=float(last.mean()),
        too_bright=float((images[-1].max(axis=2) >= _WHITE).mean()),
        too_dark=float((last <= _BLACK).mean()),
        flicker=_flicker(greys) if len(greys) >= _FEWEST_FOR_FLICKER else None,
    )


def smear_px(exposure_us: float, width_px: int) -> float:
    """How far a thing that crosses the image in two seconds moves within one exposure [px]."""
    return width_px / _SWEEP_S * exposure_us / 1e6


def exposure_advice(
    seen: Exposure, exposure_us: float | None, fps: int, width_px: int
) -> list[str]:
    """What to do, one sentence each; `exposure_us` None where the camera does not report it."""
    advice = []
    if seen.too_bright > _CLIPPED or seen.mean_grey > _BRIGHT:
        advice.append(
            f"too bright ({seen.too_bright:.0%} of it white): a shorter exposure, or less light"
        )
    if seen.too_dark > 5 * _CLIPPED or seen.mean_grey < _DARK:
        advice.append(f"too dark (mean {seen.mean_grey:.0f} of 255): more light before more gain")
    if exposure_us is not None:
        advice += _time_advice(exposure_us, fps, width_px)
    if seen.flicker is not None and seen.flicker > _FLICKER:
        advice.append(
            f"the light flickers ({seen.flicker:.0%}): expose for a multiple of 10 ms under 50 Hz "
            "lamps, of 8.3 ms under 60 Hz, or change the lamp"
        )
    return advice


def _time_advice(exposure_us: float, fps: int, width_px: int) -> list[str]:
    period_us = 1e6 / fps
    if exposure_us > period_us:
        return [
            f"exposes {exposure_us / 1000:.0f} ms, longer than a frame: the rate drops; "
            f"{period_us / 1000:.0f} ms at most"
        ]
    smear = smear_px(exposure_us, width_px)
    if smear > _SMEAR_PX:
        return [
            f"exposes {exposure_us / 1000:.1f} ms: things at full speed smear over {smear:.0f} px; "
            "more light and a shorter exposure"
        ]
    return []


def _flicker(greys: Sequence[Image]) -> float:
    """Amplitude of brightness over time, band by band (rolling shutters show lamps as bands).

    The median over the bands leaves out what moves in a part of the scene. A lamp that flickers at
    a multiple of the frame rate stands still in the image and is not seen.
    """
    rows = np.array([grey.mean(axis=1) for grey in greys], np.float64)
    usable = rows.shape[1] // _BANDS * _BANDS
    bands = rows[:, :usable].reshape(len(greys), _BANDS, -1).mean(axis=2)
    lit = bands.mean(axis=0) > _LIT_GREY
    if not lit.any():
        return 0.0
    bands = bands[:, lit] / bands[:, lit].mean(axis=0)
    drift = cv2.GaussianBlur(bands, (1, 31), 0)  # slow: the automatic exposure, a cloud
    return math.sqrt(2) * float(np.median((bands - drift).std(axis=0)))
