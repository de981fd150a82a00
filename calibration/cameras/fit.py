"""Lens and mount of a camera from views of the board, judged on views that they were not fitted to.

Cameras on the arm are placed by hand and eye, those beside it by a board whose place the arm gives.
With flange F, mount X, board B (base frame) and the board's pose Z in the camera, F X Z = B for
every pose of the arm. OpenCV's `calibrateHandEye` gives a start (Tsai, Park, Horaud, Andreff,
Daniilidis; the nearest of them); what is minimised then is what the predictive display is off by:
the distance in pixels.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import cv2
import numpy as np
from scipy.optimize import least_squares

from calibration.cameras.board import BoardView, Points, board_pose
from tams_app.prediction.plane_warp import inverse, mounted
from tams_app.records import Lens, Pose
from tams_app.rotation import Rotation

FEWEST_VIEWS, FEWEST_POSES, FEWEST_PLACES = 12, 12, 4
_FOLDS = 4
_NOWHERE = Pose(np.zeros(3), Rotation.identity())
_WORST_LENS_PX, _WORST_MOUNT_PX, _ACCURACY_PX = 1.0, 5.0, 640  # of pictures so wide


class NoFitError(ValueError):
    """The views do not determine it; why, in one clause."""


# --- the lens -------------------------------------------------------------------------------------

_WORST_FOCAL = 0.005  # standard error of the focal length, of itself
_LEAST_TILT_DEG = 10.0  # rms: seen straight, a near board and a long lens look like a far one
_CLEARLY_NEARER = 0.97  # by so much a lens with more parameters has to be nearer
_UNSEEN_MARGIN = 0.1  # beyond the outermost corner: seen up to where the distortion turns back
_FREE_OF_A_POSE = 6
_ALL_FIXED = cv2.CALIB_FIX_K1 | cv2.CALIB_FIX_K2 | cv2.CALIB_FIX_K3 | cv2.CALIB_ZERO_TANGENT_DIST
# From straight to the full model: what is fixed of the distortion.
_MODELS = (_ALL_FIXED, cv2.CALIB_FIX_K3, 0)


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
        NoFitError: Too few views, too similar ones, or none that fits them.
    """
    if len(views) < FEWEST_VIEWS:
        raise NoFitError(f"{len(views)} views of the board, {FEWEST_VIEWS} are needed")
    size = width, height
    errors = {flags: _held_out_px(views, size, flags) for flags in _MODELS}
    chosen = _MODELS[0]
    for flags in _MODELS:
        if errors[flags] < _CLEARLY_NEARER * errors[chosen]:
            chosen = flags
    error_px = errors[chosen]
    worst_px = _WORST_LENS_PX * max(1.0, width / _ACCURACY_PX)
    if not error_px <= worst_px:
        raise NoFitError(
            f"corners are {error_px:.1f} px from where the lens has them ({worst_px:.1f} are the "
            "most): is the board flat, the picture sharp, the focus fixed?"
        )
    lens, focal_error, tilt_deg = _calibrated(views, size, chosen)
    if tilt_deg < _LEAST_TILT_DEG or focal_error > _WORST_FOCAL:
        raise NoFitError(
            f"the views are too similar (tilted by {tilt_deg:.0f}° rms, the focal length "
            f"known to {focal_error:.1%}): tilt the board, to all sides and by some 30°"
        )
    if not lens.is_invertible:
        corners = np.concatenate([view.pixels for view in views])
        raise NoFitError(
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
    lens = Lens(
        "camera", _NOWHERE,
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
            board = board_in_camera(lens, view)
            points = board.position + board.rotation.apply(view.points)
            squares += float((_off_px(lens, _NOWHERE, points, view) ** 2).sum())
            free += 2 * len(view.ids) - _FREE_OF_A_POSE
    return float(np.sqrt(2.0 * squares / free))


# --- the mount ------------------------------------------------------------------------------------

_LEAST_TURN_DEG = 8.0  # rms of the rotations about their second axis
_METHODS = (
    cv2.CALIB_HAND_EYE_TSAI,
    cv2.CALIB_HAND_EYE_PARK,
    cv2.CALIB_HAND_EYE_HORAUD,
    cv2.CALIB_HAND_EYE_ANDREFF,
    cv2.CALIB_HAND_EYE_DANIILIDIS,
)
_FAR_PX = 1e3  # of what is behind the camera
_NEAR_M = 1e-3


@dataclass(frozen=True, slots=True)
class ArmView:
    """The board as a camera on the arm saw it, with the flange there (base frame)."""

    flange: Pose
    view: BoardView

    def off_px(self, lens: Lens, mount: Pose, board: Pose) -> Points:
        """How far corners of `board` (base frame) are from where they were seen, shape (2n,)."""
        points = board.position + board.rotation.apply(self.view.points)
        return _off_px(lens, mounted(self.flange, mount), points, self.view)


@dataclass(frozen=True, slots=True)
class PlacedBoard:
    """The board as a camera that stands still saw it; `points`: its corners in the base frame."""

    points: Points
    view: BoardView

    def off_px(self, lens: Lens, camera: Pose) -> Points:
        """How far the corners are from where they were seen, shape (2n,)."""
        return _off_px(lens, camera, self.points, self.view)


@dataclass(frozen=True, slots=True)
class MountFit:
    """A camera's pose, and how far corners are off (rms) in poses or places it was not fitted to.

    position_sd_mm, rotation_sd_deg: standard errors, by what the corners scatter.
    """

    pose: Pose
    error_px: float
    position_sd_mm: float
    rotation_sd_deg: float
    views: int


@dataclass(frozen=True, slots=True)
class HandEye:
    """The mount of the camera on the arm, and where the board lay (base frame)."""

    mount: MountFit
    board: Pose


def turns_problem(flanges: Sequence[Pose]) -> str:
    """Why these poses of the arm do not determine a mount, a clause; "" if they do."""
    turns = np.degrees([flanges[0].rotation.turn_to(one.rotation) for one in flanges])
    turns -= turns.mean(axis=0)
    spread = np.linalg.svd(turns, compute_uv=False) / np.sqrt(len(flanges))
    if spread[0] < _LEAST_TURN_DEG:
        return f"the arm turned too little ({spread[0]:.0f}° rms): turn the flange by 30° and more"
    if spread[1] < _LEAST_TURN_DEG:
        return (
            f"the arm turned about one axis only ({spread[1]:.0f}° rms about others): turn it "
            "about the camera's axis and tilt it as well"
        )
    return ""


def fit_hand_eye(lens: Lens, views: Sequence[ArmView]) -> HandEye:
    """The mount of a camera on the flange; NoFitError if the views do not determine it."""
    if len(views) < FEWEST_POSES:
        raise NoFitError(f"{len(views)} poses of the arm, {FEWEST_POSES} are needed")
    if problem := turns_problem([view.flange for view in views]):
        raise NoFitError(problem)
    mount, (board,) = _judged(lens, views, _FOLDS)
    return HandEye(mount, board)


def fit_fixed(lens: Lens, places: Sequence[PlacedBoard]) -> MountFit:
    """The pose of a camera that stands still, base frame; NoFitError if they are too few."""
    if len(places) < FEWEST_PLACES:
        raise NoFitError(f"{len(places)} places of the board, {FEWEST_PLACES} are needed")
    return _judged(lens, places, len(places))[0]


def board_in_camera(lens: Lens, view: BoardView) -> Pose:
    """Where the board is in the camera's frame, through its lens."""
    return board_pose(view, lens.matrix(), np.array(lens.distortion))


def _judged(
    lens: Lens, views: Sequence[ArmView | PlacedBoard], folds: int
) -> tuple[MountFit, tuple[Pose, ...]]:
    """The camera's pose, judged on each fold by fits to the others; further poses."""
    squares, count = 0.0, 0
    for fold in range(folds):
        kept = [view for number, view in enumerate(views) if number % folds != fold]
        fitted = _fitted(lens, kept)
        for view in views[fold::folds]:
            off = view.off_px(lens, *fitted.poses)
            squares, count = squares + float(off @ off), count + len(off) // 2
    error_px = float(np.sqrt(squares / count))
    worst_px = _WORST_MOUNT_PX * max(1.0, lens.width / _ACCURACY_PX)
    if not error_px <= worst_px:
        raise NoFitError(
            f"corners are {error_px:.1f} px from where arm and camera have them ({worst_px:.1f} "
            "are the most): did the board or a camera move, is --square-mm right, is it this arm?"
        )
    fitted = _fitted(lens, views)
    pose, *others = fitted.poses
    return MountFit(pose, error_px, *fitted.spread, len(views)), tuple(others)


@dataclass(frozen=True, slots=True)
class _Fitted:
    poses: tuple[Pose, ...]
    spread: tuple[float, float]  # of the first [mm, degrees]


def _fitted(lens: Lens, views: Sequence[ArmView | PlacedBoard]) -> _Fitted:
    """The pose of the camera; of one on the arm and that of the board."""
    on_arm = [view for view in views if isinstance(view, ArmView)]
    if on_arm:
        return _nearest(lens, on_arm, _start_on_arm(lens, on_arm))
    placed = [view for view in views if isinstance(view, PlacedBoard)]
    return _nearest(lens, placed, (_start_beside(lens, placed),))


def _start_on_arm(lens: Lens, views: Sequence[ArmView]) -> tuple[Pose, Pose]:
    """Initial mount and board poses: those of OpenCV's methods with the least pixel error."""
    seen = [board_in_camera(lens, view.view) for view in views]
    flanges = [view.flange for view in views]
    candidates: list[tuple[float, int, tuple[Pose, Pose]]] = []
    for method in _METHODS:
        turn, way = cv2.calibrateHandEye(
            [one.rotation.as_matrix() for one in flanges],
            [one.position for one in flanges],
            [one.rotation.as_matrix() for one in seen],
            [one.position for one in seen],
            method=method,
        )
        if not (np.isfinite(turn).all() and np.isfinite(way).all()):
            continue
        mount = Pose(np.ravel(way), Rotation.from_matrix(np.asarray(turn, np.float64)))
        boards = [
            mounted(mounted(flange, mount), one) for flange, one in zip(flanges, seen, strict=True)
        ]
        board = Pose(np.median([one.position for one in boards], axis=0), _middle(boards))
        off = _all_off_px(lens, views, (mount, board))
        candidates.append((float(off @ off), len(candidates), (mount, board)))
    if not candidates:
        raise NoFitError("none of the methods for hand and eye found a mount")
    return min(candidates)[2]


def _middle(poses: Sequence[Pose]) -> Rotation:
    """The rotation among them that is nearest to all others."""
    turns = [one.rotation for one in poses]
    return min(turns, key=lambda one: sum((one.inv() * other).magnitude() for other in turns))


def _start_beside(lens: Lens, places: Sequence[PlacedBoard]) -> Pose:
    points = np.concatenate([place.points for place in places])
    pixels = np.concatenate([place.view.pixels for place in places])
    _, turn, way = cv2.solvePnP(
        points, pixels, lens.matrix(), np.array(lens.distortion), flags=cv2.SOLVEPNP_SQPNP
    )
    base = Pose(np.ravel(way), Rotation.from_rotvec(np.ravel(turn).tolist()))
    return inverse(base)


def _nearest(
    lens: Lens, views: Sequence[ArmView | PlacedBoard], start: tuple[Pose, ...]
) -> _Fitted:
    """The poses by which corners are least off, from `start` on; far ones count less."""

    def moved(steps: Points) -> tuple[Pose, ...]:
        return tuple(
            Pose(pose.position + step[:3], pose.rotation * Rotation.from_rotvec(step[3:]))
            for pose, step in zip(start, steps.reshape(-1, 6), strict=True)
        )

    found = least_squares(
        lambda steps: _all_off_px(lens, views, moved(steps)),
        np.zeros(6 * len(start)),
        loss="soft_l1",
        x_scale="jac",
    )
    free = max(1, len(found.fun) - len(found.x))
    variance = np.linalg.pinv(found.jac.T @ found.jac) * float(found.fun @ found.fun) / free
    deviations = np.sqrt(np.diag(variance))
    spread = (
        float(np.linalg.norm(deviations[:3])) * 1000.0,
        float(np.degrees(np.linalg.norm(deviations[3:6]))),
    )
    return _Fitted(moved(found.x), spread)


def _all_off_px(
    lens: Lens, views: Sequence[ArmView | PlacedBoard], poses: tuple[Pose, ...]
) -> Points:
    return np.concatenate([view.off_px(lens, *poses) for view in views])


def _off_px(lens: Lens, camera: Pose, points: Points, view: BoardView) -> Points:
    """How far `points`, in the parent frame of `camera`, are from where it saw them, (2n,) [px]."""
    seen = (points - camera.position) @ camera.rotation.as_matrix()
    depth = seen[:, 2:]
    pixels = lens.pixels(seen[:, :2] / np.maximum(depth, _NEAR_M))
    off = np.where(depth > _NEAR_M, pixels - view.pixels, _FAR_PX)
    return np.asarray(off.ravel())
