"""The frame from points that the robot has reached and the hand then touched.

Four points are needed, spread out in a plane at least: a proper rotation needs no depth, but only
points that are not in one plane would show a mirrored set.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy import stats
from scipy.spatial import transform

from calibration.frame.fit import Matrix, bound_rad, kabsch
from calibration.frame.stroke import RefusedError, StrokeFault
from tams_app.errors import ConfigError
from tams_app.records import Vector
from tams_app.rotation import Rotation

MIN_TOUCHES = 4
MIN_SPREAD_M = 0.05  # RMS, across the line that fits the robot's points best
MAX_HAND_TURN_DEG = 10.0  # the touching spot is some way from the tracked one
OUTLIER_M = 0.010
OUTLIER_CHANCE = 0.001  # of leaving out one of a set of good touches
SCALES = (0.2, 5.0)
COLUMNS = ("x_mm", "y_mm", "z_mm")


@dataclass(frozen=True, slots=True, eq=False)
class Touch:
    """One point [m], shape (3,): in the arm's base frame, and where the hand touched it."""

    robot: Vector
    hand: Vector
    hand_rotation: Rotation


@dataclass(frozen=True, slots=True, eq=False)
class TouchFit:
    """robot = scale · rotation · hand + constant."""

    rotation: Matrix
    scale: float  # robot travel per hand travel
    error_bound_deg: float  # 95 %
    residual_mm: float  # RMS, of the touches that count
    misses_mm: tuple[float, ...]  # of each touch, from the frame that the others make
    left_out: tuple[int, ...]  # which touches do not count
    condition: float  # longest over second longest extent of the points, infinite on one line
    is_flat: bool  # the points lie in one plane: a mirrored set would not show


@dataclass(frozen=True, slots=True, eq=False)
class SimilarityTransform:
    """robot = scale · rotation · hand + offset."""

    scale: float
    rotation: Matrix
    offset: Vector  # [m]

    def __call__(self, hand: Matrix) -> Matrix:
        return np.asarray(self.scale * hand @ self.rotation.T + self.offset)


def umeyama(hand: Matrix, robot: Matrix) -> SimilarityTransform:
    """The similarity that takes rows of `hand` to those of `robot` by least squares (1991)."""
    from_hand, to_robot = hand - hand.mean(axis=0), robot - robot.mean(axis=0)
    rotation = kabsch(from_hand, to_robot)
    scale = float((to_robot * (from_hand @ rotation.T)).sum() / (from_hand**2).sum())
    return SimilarityTransform(
        scale, rotation, robot.mean(axis=0) - scale * rotation @ hand.mean(axis=0)
    )


def read_points(path: Path) -> list[Vector]:
    """Points [m] of the arm's base frame from columns x_mm, y_mm, z_mm; ConfigError if unfit."""
    try:
        with path.open(encoding="utf-8-sig", newline="") as file:
            rows = list(csv.DictReader(file, skipinitialspace=True))
    except OSError as error:
        raise ConfigError(f"{path}: cannot be read: {error.strerror}") from error
    except (UnicodeDecodeError, csv.Error) as error:
        raise ConfigError(f"{path}: is not a table of text") from error
    points = []
    for line, row in enumerate(rows, start=2):
        try:
            point = np.array([float(row[column]) for column in COLUMNS]) / 1000
        except (KeyError, TypeError, ValueError) as error:
            raise ConfigError(
                f"{path}: line {line}: must hold numbers under {', '.join(COLUMNS)}"
            ) from error
        if not np.isfinite(point).all():
            raise ConfigError(f"{path}: line {line}: must hold finite numbers")
        points.append(point)
    try:
        check_points(points)
    except RefusedError as error:
        raise ConfigError(f"{path}: {error}") from error
    return points


def fit_touches(touches: Sequence[Touch]) -> TouchFit:
    """The frame from at least four touches; RefusedError says what to do instead.

    A touch that the frame of the others misses by more than 10 mm, and by more than chance explains
    (see `_outlier`), is left out, the worst first, as long as four remain.
    """
    check_points([touch.robot for touch in touches])
    _check_hand(touches)
    hand = np.array([touch.hand for touch in touches])
    robot = np.array([touch.robot for touch in touches])
    _refuse_mirrored(hand, robot)  # before touches that make it one are taken for wrong ones
    kept = list(range(len(touches)))
    left_out: list[int] = []
    while (worst := _outlier(hand[kept], robot[kept])) is not None:
        if len(kept) == MIN_TOUCHES:
            raise RefusedError(
                StrokeFault.CONTRADICTORY,
                f"Touch {kept[worst] + 1} does not fit the others: "
                "touch them again, that one with care.",
            )
        left_out.append(kept.pop(worst))
    hand_kept, robot_kept = hand[kept], robot[kept]
    frame = umeyama(hand_kept, robot_kept)
    extents = _extents(robot_kept)
    if extents[1] < MIN_SPREAD_M:
        raise _too_flat(extents[1])
    error = frame(hand_kept) - robot_kept
    _refuse_mirrored(hand_kept, robot_kept)
    if not SCALES[0] <= frame.scale <= SCALES[1]:
        raise RefusedError(
            StrokeFault.IMPOSSIBLE_SCALE,
            f"The robot's points are {frame.scale:.2g} times as far apart as the hand's: "
            "check the list's unit (mm) and its order.",
        )
    return TouchFit(
        frame.rotation,
        frame.scale,
        math.degrees(_bound_rad(error, robot_kept)),
        1000 * float(np.sqrt((error**2).sum() / len(kept))),
        tuple(1000 * _miss(hand, robot, kept, n) for n in range(len(touches))),
        tuple(sorted(left_out)),
        float(extents[0] / extents[1]),
        bool(extents[2] < MIN_SPREAD_M / 2),
    )


def check_points(points: Sequence[Vector]) -> None:
    """RefusedError if touching the robot's points [m] cannot give a frame."""
    if len(points) < MIN_TOUCHES:
        raise RefusedError(
            StrokeFault.MISSING,
            f"{len(points)} points are too few: touch at least {MIN_TOUCHES}.",
        )
    extents = _extents(np.array(points))
    if extents[1] < MIN_SPREAD_M:
        raise _too_flat(extents[1])


def mean_rotation(rotations: Sequence[Rotation]) -> Rotation:
    """The rotation that is least turned from all of them."""
    return Rotation.from_quat(transform.Rotation.from_quat(rotations).mean().as_quat())


def _check_hand(touches: Sequence[Touch]) -> None:
    mean = mean_rotation([touch.hand_rotation for touch in touches])
    for number, touch in enumerate(touches, start=1):
        turn = math.degrees((mean.inv() * touch.hand_rotation).magnitude())
        if turn > MAX_HAND_TURN_DEG:
            raise RefusedError(
                StrokeFault.TURNED_HAND,
                f"At touch {number} the controller was turned by {turn:.0f}° from its mean: "
                "hold it the same way at every point, for its tip is not where it is tracked.",
            )


def _too_flat(spread_m: float) -> RefusedError:
    return RefusedError(
        StrokeFault.NOT_INDEPENDENT,
        f"The points lie nearly on one line ({1000 * spread_m:.0f} mm across it): "
        f"choose points at least {2000 * MIN_SPREAD_M:.0f} mm apart in two directions.",
    )


def _extents(points: Matrix) -> Matrix:
    """RMS along the three principal axes [m], largest first."""
    centred = points - points.mean(axis=0)
    return np.asarray(np.linalg.svd(centred, compute_uv=False) / math.sqrt(len(points)))


def _outlier(hand: Matrix, robot: Matrix) -> int | None:
    """The touch whose absence mends the fit most, if it is far off and that is no chance.

    An F test of its three residuals against those of the rest, for as many tries as touches.
    """
    everyone = range(len(hand))
    rest = [[m for m in everyone if m != n] for n in everyone]
    misfits = [_squares(hand[others], robot[others]) for others in rest]
    worst = int(np.argmin(misfits))
    freedom = 3 * (len(hand) - 1) - 7
    gained = _squares(hand, robot) - misfits[worst]
    limit = float(stats.f.isf(OUTLIER_CHANCE / len(hand), 3, freedom))
    is_far = _miss(hand, robot, rest[worst], worst) > OUTLIER_M
    return worst if is_far and gained / 3 > limit * misfits[worst] / freedom else None


def _squares(hand: Matrix, robot: Matrix) -> float:
    return float(((umeyama(hand, robot)(hand) - robot) ** 2).sum())


def _miss(hand: Matrix, robot: Matrix, kept: Sequence[int], number: int) -> float:
    """How far the frame of the other touches that count misses this one [m]."""
    others = [n for n in kept if n != number]
    predicted = umeyama(hand[others], robot[others])(hand[number])
    return float(np.linalg.norm(predicted - robot[number]))


def _bound_rad(error: Matrix, robot: Matrix) -> float:
    centred = robot - robot.mean(axis=0)
    information = np.eye(3) * float((centred**2).sum()) - centred.T @ centred
    freedom = 3 * len(robot) - 7
    return bound_rad(information, float((error**2).sum()) / freedom, freedom)


def _refuse_mirrored(hand: Matrix, robot: Matrix) -> None:
    """RefusedError if a mirrored hand fits well, and clearly better."""
    found, mirrored = _squares(hand, robot), _squares(hand * [1.0, 1.0, -1.0], robot)
    if mirrored < len(hand) * OUTLIER_M**2 and found > max(4 * mirrored, OUTLIER_M**2):
        raise RefusedError(
            StrokeFault.MIRRORED,
            "The touches make a mirrored frame: two points were taken for one another, or an axis "
            "of the list has the wrong sign; check the list and touch them all again.",
        )
