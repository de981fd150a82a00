"""The lens from views of the board, judged on views that it was not fitted to."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from calibration.cameras.board import BoardView, Points, board_pose
from tams_app.records import Lens, Pose
from tams_app.rotation import Rotation

FEWEST_VIEWS = 12
_FOLDS = 4
_ACCURACY_PX = 640  # pictures of this width
_WORST_PX = 1.0
_WORST_FOCAL = 0.005  # standard error of the focal length, of itself
_LEAST_TILT_DEG = 10.0  # rms: seen straight, a near board and a long lens look like a far one
_CLEARLY_NEARER = 0.97  # by so much a lens with more parameters has to be nearer
_UNSEEN_MARGIN = 0.1  # beyond the outermost corner: seen up to where the distortion turns back
_FREE_OF_A_POSE = 6
_ALL_FIXED = cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
# From straight to the full model: what is fixed of the distortion.
_MODELS = (_ALL_FIXED, cv2.CALIB_FIX_K3, 0)


class NoLensError(ValueError):
    """The views do not determine the lens; why, in one clause."""


@dataclass(frozen=True, slots=True)
class LensFit:
    """A lens, the rms distance of corners in views it was not fitted to, and how sure its focus is.

    focal_error: standard error of the focal length, as a share of it.
    """

    lens: Lens  # at the origin of no frame
    error_px: float
    focal_error: float
    views: int


def fit_lens(views: Sequence[BoardView], width: int, height: int) -> LensFit:
    """The simplest of three models of distortion that is as good as the others on held-out views.

    Raises:
        NoLensError: Too few views, too similar ones, or none that fits them.
    """
    if len(views) < FEWEST_VIEWS:
        raise NoLensError(f"{len(views)} views of the board, {FEWEST_VIEWS} are needed")
    size = width, height
    errors = {flags: _held_out_px(views, size, flags) for flags in _MODELS}
    chosen = _MODELS[0]
    for flags in _MODELS:
        if errors[flags] < _CLEARLY_NEARER * errors[chosen]:
            chosen = flags
    error_px = errors[chosen]
    worst_px = _WORST_PX * max(1.0, width / _ACCURACY_PX)
    if not error_px <= worst_px:
        raise NoLensError(
            f"corners are {error_px:.1f} px from where the lens has them ({worst_px:.1f} are the "
            "most): is the board flat, the picture sharp, the focus fixed?"
        )
    lens, focal_error, tilt_deg = _calibrated(views, size, chosen)
    if tilt_deg < _LEAST_TILT_DEG or focal_error > _WORST_FOCAL:
        raise NoLensError(
            f"the views are too similar (tilted by {tilt_deg:.0f}° rms, the focal length "
            f"known to {focal_error:.1%}): tilt the board, to all sides and by some 30°"
        )
    if not lens.is_invertible:
        corners = np.concatenate([view.pixels for view in views])
        raise NoLensError(
            "it bends as a fisheye lens does, which the model cannot describe: take another lens"
            if lens.turns_back_at(corners, _UNSEEN_MARGIN)
            else "the picture's outermost parts are not known, for no corner of the board was seen "
            "there: show the board farther out, into the corners of the picture"
        )
    return LensFit(lens, error_px, focal_error, len(views))


def _calibrated(
    views: Sequence[BoardView], size: tuple[int, int], flags: int
) -> tuple[Lens, float, float]:
    """The lens, its focal error, and the board's tilt from its mean direction [degrees], rms."""
    _, matrix, distortion, turns, _, deviations, _, _ = cv2.calibrateCameraExtended(
        [view.points.astype(np.float32) for view in views],
        [view.pixels.astype(np.float32) for view in views],
        size,
        np.eye(3),
        np.zeros(5),
        flags=flags,
    )
    k1, k2, p1, p2, k3 = (float(number) for number in np.ravel(distortion)[:5])
    middle = Pose(np.zeros(3), Rotation.identity())
    lens = Lens(
        "camera", middle,
        float(matrix[0, 0]), float(matrix[1, 1]), float(matrix[0, 2]), float(matrix[1, 2]),
        *size, (k1, k2, p1, p2, k3),
    )  # fmt: skip
    shares = np.ravel(deviations)[:2] / (lens.fx, lens.fy)
    boards = [Rotation.from_rotvec(np.ravel(turn).tolist()) for turn in turns]
    normals = np.array([board.as_matrix()[:, 2] for board in boards])
    mean = normals.mean(axis=0)
    cosines = np.clip(normals @ (mean / np.linalg.norm(mean)), -1.0, 1.0)
    tilt_deg = float(np.degrees(np.sqrt((np.arccos(cosines) ** 2).mean())))
    return lens, float(shares.max()), tilt_deg


def _held_out_px(views: Sequence[BoardView], size: tuple[int, int], flags: int) -> float:
    """The rms distance of corners in each quarter of the views from a lens fitted to the others.

    Of a held-out view the board's pose alone is fitted, whose six numbers are allowed for.
    """
    squares, free = 0.0, 0
    for fold in range(_FOLDS):
        kept = [view for number, view in enumerate(views) if number % _FOLDS != fold]
        lens, *_ = _calibrated(kept, size, flags)
        for view in views[fold::_FOLDS]:
            squares += float((residuals(view, lens) ** 2).sum())
            free += 2 * len(view.ids) - _FREE_OF_A_POSE
    return float(np.sqrt(2.0 * squares / free))


def residuals(view: BoardView, lens: Lens) -> Points:
    """How far the corners are from where `lens` has those of a board in the best place [px]."""
    matrix, distortion = lens.matrix(), np.array(lens.distortion)
    pose = board_pose(view, matrix, distortion)
    seen = pose.position + pose.rotation.apply(view.points)
    return np.asarray(lens.pixels(seen[:, :2] / seen[:, 2:]) - view.pixels)
