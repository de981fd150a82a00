"""Where cameras are: on the arm by hand and eye, beside it by a board whose place the arm gives.

With flange F, mount X, board B (base frame) and the board's pose Z in the camera, F X Z = B for
every pose of the arm. OpenCV's `calibrateHandEye` gives a start (Tsai, Park, Horaud, Andreff,
Daniilidis; the nearest of them); what is minimised then is what the predictive display is off by:
the distance in pixels.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeVar

import cv2
import numpy as np
from scipy.optimize import least_squares

from calibration.cameras.board import BoardView, Points, board_pose
from tams_app.prediction.plane_warp import inverse, mounted
from tams_app.records import Lens, Pose
from tams_app.rotation import Rotation

FEWEST_POSES, FEWEST_PLACES = 12, 4
_FOLDS = 4
_LEAST_TURN_DEG = 8.0  # rms of the rotations about their second axis
_WORST_PX, _ACCURACY_PX = 5.0, 640
_METHODS = (
    cv2.CALIB_HAND_EYE_TSAI,
    cv2.CALIB_HAND_EYE_PARK,
    cv2.CALIB_HAND_EYE_HORAUD,
    cv2.CALIB_HAND_EYE_ANDREFF,
    cv2.CALIB_HAND_EYE_DANIILIDIS,
)
_FAR_PX = 1e3  # of what is behind the camera
_NEAR_M = 1e-3


class NoMountError(ValueError):
    """The views do not determine where the camera is; why, in one clause."""


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
class Placed:
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


View = TypeVar("View", ArmView, Placed)


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
    """The mount of a camera on the flange; NoMountError if the views do not determine it."""
    if len(views) < FEWEST_POSES:
        raise NoMountError(f"{len(views)} poses of the arm, {FEWEST_POSES} are needed")
    if problem := turns_problem([view.flange for view in views]):
        raise NoMountError(problem)
    mount, (board,) = _judged(lens, views, _FOLDS, _fit_arm)
    return HandEye(mount, board)


def fit_fixed(lens: Lens, places: Sequence[Placed]) -> MountFit:
    """The pose of a camera that stands still, base frame; NoMountError if they are too few."""
    if len(places) < FEWEST_PLACES:
        raise NoMountError(f"{len(places)} places of the board, {FEWEST_PLACES} are needed")
    return _judged(lens, places, len(places), _fit_placed)[0]


def board_in_camera(lens: Lens, view: BoardView) -> Pose:
    """Where the board is in the camera's frame, through its lens."""
    return board_pose(view, lens.matrix(), np.array(lens.distortion))


def _judged(
    lens: Lens,
    views: Sequence[View],
    folds: int,
    fit: Callable[[Lens, Sequence[View]], _Fitted],
) -> tuple[MountFit, tuple[Pose, ...]]:
    """The first pose that `fit` gives, judged on each fold by fits to the others; further poses."""
    squares, count = 0.0, 0
    for fold in range(folds):
        fitted = fit(lens, [view for number, view in enumerate(views) if number % folds != fold])
        for view in views[fold::folds]:
            off = view.off_px(lens, *fitted.poses)
            squares, count = squares + float(off @ off), count + len(off) // 2
    error_px = float(np.sqrt(squares / count))
    worst_px = _WORST_PX * max(1.0, lens.width / _ACCURACY_PX)
    if not error_px <= worst_px:
        raise NoMountError(
            f"corners are {error_px:.1f} px from where arm and camera have them ({worst_px:.1f} "
            "are the most): did the board or a camera move, is --square-mm right, is it this arm?"
        )
    fitted = fit(lens, views)
    pose, *others = fitted.poses
    return MountFit(pose, error_px, *fitted.spread, len(views)), tuple(others)


@dataclass(frozen=True, slots=True)
class _Fitted:
    poses: tuple[Pose, ...]
    spread: tuple[float, float]  # of the first [mm, degrees]


def _fit_arm(lens: Lens, views: Sequence[ArmView]) -> _Fitted:
    return _nearest(lens, views, _start(lens, views))


def _start(lens: Lens, views: Sequence[ArmView]) -> tuple[Pose, Pose]:
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
        raise NoMountError("none of the methods for hand and eye found a mount")
    return min(candidates)[2]


def _middle(poses: Sequence[Pose]) -> Rotation:
    """The rotation among them that is nearest to all others."""
    turns = [one.rotation for one in poses]
    return min(turns, key=lambda one: sum((one.inv() * other).magnitude() for other in turns))


def _fit_placed(lens: Lens, places: Sequence[Placed]) -> _Fitted:
    points = np.concatenate([place.points for place in places])
    pixels = np.concatenate([place.view.pixels for place in places])
    _, turn, way = cv2.solvePnP(
        points, pixels, lens.matrix(), np.array(lens.distortion), flags=cv2.SOLVEPNP_SQPNP
    )
    base = Pose(np.ravel(way), Rotation.from_rotvec(np.ravel(turn).tolist()))
    return _nearest(lens, places, (inverse(base),))


def _nearest(lens: Lens, views: Sequence[ArmView | Placed], start: tuple[Pose, ...]) -> _Fitted:
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


def _all_off_px(lens: Lens, views: Sequence[ArmView | Placed], poses: tuple[Pose, ...]) -> Points:
    return np.concatenate([view.off_px(lens, *poses) for view in views])


def _off_px(lens: Lens, camera: Pose, points: Points, view: BoardView) -> Points:
    """By how far `points` of the base frame are from where `camera` saw them, shape (2n,) [px]."""
    seen = (points - camera.position) @ camera.rotation.as_matrix()
    depth = seen[:, 2:]
    pixels = lens.pixels(seen[:, :2] / np.maximum(depth, _NEAR_M))
    off = np.where(depth > _NEAR_M, pixels - view.pixels, _FAR_PX)
    return np.asarray(off.ravel())
