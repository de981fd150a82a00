"""Whether an image is too bright, too dark, smeared by motion, or beaten by a lamp."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from tams_app.records import Image

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
    """What to do, one sentence each; `exposure_us` None where the camera does not tell."""
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
