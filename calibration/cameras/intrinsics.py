"""A lens from views of a board: focal lengths, principal point, distortion, and their errors."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from calibration.cameras.board import BoardView

FEWEST_VIEWS = 10
MOST_RMS_PX = 1.0
_OUTLIER = 3.0  # times the median error of a view
NAMES = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2")


@dataclass(frozen=True, slots=True)
class Intrinsics:
    """OpenCV's model; focal lengths and principal point [px], distortion without unit.

    `errors`: one standard deviation each, from the fit (white noise on the corners): what the
    board is bent or misprinted is not in it.
    """

    values: dict[str, float]
    errors: dict[str, float]
    rms_px: float  # reprojection error
    view_rms_px: tuple[float, ...]
    left_out: int  # views that did not fit
    width: int
    height: int


def fit_intrinsics(views: Sequence[BoardView], width: int, height: int) -> Intrinsics:
    """Least squares over all views, then again without those that do not fit.

    ValueError says in one sentence what is wrong with the data. k3 is held at 0: at the views'
    angles it cannot be told from k2.
    """
    if len(views) < FEWEST_VIEWS:
        raise ValueError(f"{len(views)} views of the board; show at least {FEWEST_VIEWS}")
    first = _fit(views, width, height, 0)
    median = float(np.median(first.view_rms_px))
    kept = [
        view
        for view, rms in zip(views, first.view_rms_px, strict=True)
        if rms <= max(_OUTLIER * median, 0.3)
    ]
    if len(kept) < FEWEST_VIEWS:
        raise ValueError(
            f"only {len(kept)} of {len(views)} views fit one lens; hold the board still and flat"
        )
    found = first if len(kept) == len(views) else _fit(kept, width, height, len(views) - len(kept))
    if found.rms_px > MOST_RMS_PX:
        raise ValueError(
            f"corners are {found.rms_px:.1f} px off the best lens; is the board flat, and are its "
            "squares as long as --square-mm says?"
        )
    return found


def _fit(views: Sequence[BoardView], width: int, height: int, left_out: int) -> Intrinsics:
    rms, matrix, distortion, _, _, deviations, _, view_rms = cv2.calibrateCameraExtended(
        [view.object_points for view in views],
        [view.image_points for view in views],
        (width, height),
        np.eye(3),  # not used: no guess is given
        np.zeros(5),
        flags=cv2.CALIB_FIX_K3,
    )
    k = distortion.ravel()
    values = (matrix[0, 0], matrix[1, 1], matrix[0, 2], matrix[1, 2], k[0], k[1], k[2], k[3])
    return Intrinsics(
        values=dict(zip(NAMES, map(float, values), strict=True)),
        errors=dict(zip(NAMES, map(float, deviations.ravel()[: len(NAMES)]), strict=True)),
        rms_px=float(rms),
        view_rms_px=tuple(float(each) for each in view_rms.ravel()),
        left_out=left_out,
        width=width,
        height=height,
    )
