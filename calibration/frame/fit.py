"""The frame from strokes along the robot's axes, and why a measurement is refused.

Each stroke gives a direction. Of all ways to pick one stroke for each axis, the one whose rotation
agrees best with all strokes starts (truncated squares, so a wrong stroke counts no more than a poor
one); strokes more than 10° from it are left out, and the rotation is fitted to the rest. Both as
RANSAC does it, but with every pick tried.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, product

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from tams_app.errors import TamsError
from tams_app.records import Vector
from tams_app.rotation import Rotation

Matrix = NDArray[np.float64]

CONFIDENCE = 0.95
AXES = ("x", "y", "z")

ASKED_LENGTH_M = 0.200
MIN_LENGTH_M = 0.180  # noise at the ends makes a stroke look longer or shorter
MIN_SAMPLES = 50
MAX_BOW = 0.08  # of the length, from the chord to the arc's top
MAX_BACKTRACK = 0.25  # of the length
MAX_SCATTER_M = 0.010  # of the samples about the line, one axis
_ENDS = 0.2  # of the samples: beginning and end, for a first direction that no jump can spoil
_TRIM = 4.0  # standard deviations from the line: beyond them a sample does not count
_SCATTER_FLOOR_M = 1e-4
_ROUNDS = 10
_MEDIAN_STEPS = 15
_RAYLEIGH_MEDIAN = 1.1774  # of the distance from a line, in standard deviations of one axis


class RefusedError(TamsError):
    """What was measured is no use; the sentence says what to do."""


class BeginAgainError(TamsError):
    """What was measured before holds no longer; the sentence says why."""


@dataclass(frozen=True, slots=True, eq=False)
class Stroke:
    """The hand's positions [m], shape (n, 3), in order of time, while it was to go along `axis`.

    `axis`: 0, 1, 2 for the robot's +x, +y, +z. The positions are in the tracking frame.
    """

    axis: int
    positions: Matrix


@dataclass(frozen=True, slots=True, eq=False)
class StrokeLine:
    """The line through a stroke, in the direction the hand went."""

    axis: int
    centre: Vector  # [m], of the samples that count
    direction: Vector  # unit, shape (3,)
    length_m: float
    scatter_m: float  # about the line, one axis, one standard deviation
    bow: float  # of the length
    backtrack: float  # of the length: how far it went back
    samples: int
    kept: NDArray[np.bool_]  # which samples count, shape (samples,)

    @property
    def name(self) -> str:
        return f"+{AXES[self.axis]}"

    @property
    def straightness(self) -> float:
        """1 for a straight line: 1 - bow."""
        return max(0.0, 1.0 - self.bow)


def fit_line(stroke: Stroke) -> StrokeLine:
    """The line by least squares over the samples within 4 σ of it, repeated until they stand.

    σ comes from the median distance, and the first direction from the medians of the first and
    the last fifth, so that jumps of the tracking pull neither. RefusedError below three samples.
    """
    points = stroke.positions
    count = len(points)
    if count < 3:
        raise _too_few(f"+{AXES[stroke.axis]}", count)
    ends = max(1, round(_ENDS * count))
    first, last = _median(points[:ends]), _median(points[-ends:])
    direction, centre = _unit(last - first), _median(points)
    kept = np.ones(count, dtype=bool)
    for _ in range(_ROUNDS):
        distance = np.linalg.norm(_across(points - centre, direction), axis=1)
        sigma = max(float(np.median(distance[kept])) / _RAYLEIGH_MEDIAN, _SCATTER_FLOOR_M)
        near = distance <= _TRIM * sigma
        if near.sum() < 3:
            break
        centre = points[near].mean(axis=0)
        direction = np.linalg.svd(points[near] - centre, full_matrices=False)[2][0]
        done, kept = bool((near == kept).all()), near
        if done:
            break
    if direction @ (last - first) < 0:
        direction = -direction
    offset = points[kept] - centre
    along, across = offset @ direction, _across(offset, direction)
    length = float(np.ptp(along))
    relative = 1.0 / length if length > 0 else 0.0
    return StrokeLine(
        axis=stroke.axis,
        centre=centre,
        direction=direction,
        length_m=length,
        scatter_m=float(np.sqrt((across**2).sum() / (2 * max(1, len(along) - 2)))),
        bow=_sagitta(along, across) * relative,
        backtrack=float((np.maximum.accumulate(along) - along).max()) * relative,
        samples=count,
        kept=kept,
    )


def check_line(line: StrokeLine) -> None:
    """RefusedError with what is wrong with this stroke by itself."""
    length_mm = 1000 * line.length_m
    if line.samples < MIN_SAMPLES:
        raise _too_few(line.name, line.samples)
    if line.length_m < MIN_LENGTH_M:
        raise RefusedError(
            f"The {line.name} stroke was {length_mm:.0f} mm long: "
            f"make it at least {1000 * ASKED_LENGTH_M:.0f} mm."
        )
    if line.backtrack > MAX_BACKTRACK:
        raise RefusedError(
            f"The {line.name} stroke went back {line.backtrack * length_mm:.0f} mm: "
            "move one way, and let the trigger go at the end."
        )
    if line.bow > MAX_BOW:
        raise RefusedError(
            f"The {line.name} stroke is bent by {line.bow * length_mm:.0f} mm over "
            f"{length_mm:.0f} mm: move along something straight, such as the table's edge."
        )
    if line.scatter_m > MAX_SCATTER_M:
        raise RefusedError(
            f"The {line.name} stroke scatters by {1000 * line.scatter_m:.0f} mm: "
            "go to where the controller is tracked well, and move steadily."
        )


def _median(points: Matrix) -> Vector:
    """The geometric median (Weiszfeld): unlike that of each axis, it turns as the points turn."""
    place = points.mean(axis=0)
    for _ in range(_MEDIAN_STEPS):
        weight = 1.0 / np.maximum(np.linalg.norm(points - place, axis=1), _SCATTER_FLOOR_M)
        place = weight @ points / weight.sum()
    return np.asarray(place)


def _sagitta(along: Vector, across: Matrix) -> float:
    """How far the parabola through the samples rises above its chord [m]."""
    half = float(np.ptp(along)) / 2
    if len(along) < 4 or half == 0:
        return 0.0
    basis = np.stack((np.ones_like(along), along / half, (along / half) ** 2), axis=1)
    curvature = np.linalg.lstsq(basis, across, rcond=None)[0][2]
    return float(np.linalg.norm(curvature))


def _across(offset: Matrix, direction: Vector) -> Matrix:
    return np.asarray(offset - np.outer(offset @ direction, direction))


def _unit(vector: Vector) -> Vector:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0 else np.array([1.0, 0.0, 0.0])


def _too_few(name: str, count: int) -> RefusedError:
    return RefusedError(
        f"The {name} stroke has {count} samples of the {MIN_SAMPLES} it takes: "
        "move for about two seconds with the trigger held."
    )


# --- the frame -----------------------------------------------------------------------------------


def kabsch(measured: Matrix, wanted: Matrix) -> Matrix:
    """The proper rotation R, shape (3, 3), that minimises Σ|R m - w|² over rows m, w.

    Kabsch (1976), by singular values; never a mirror (Umeyama 1991).
    """
    u, _, vt = np.linalg.svd(wanted.T @ measured)
    flip = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    return np.asarray(u @ flip @ vt)


def angles_deg(rotation: Matrix, measured: Matrix, wanted: Matrix) -> NDArray[np.float64]:
    """Between each R m and w [deg], shape (n,); rows are unit vectors."""
    turned = measured @ rotation.T
    sine = np.linalg.norm(np.cross(turned, wanted), axis=1)
    cosine = (turned * wanted).sum(axis=1)
    return np.asarray(np.degrees(np.arctan2(sine, cosine)))


def turn_deg(one: Matrix, other: Matrix) -> float:
    """The angle between two rotations [deg]."""
    return math.degrees(Rotation.from_matrix(one @ other.T).magnitude())


def bound_rad(information: Matrix, variance: float, freedom: int) -> float:
    """How far the rotation may be off [rad], with 95 % confidence, about its worst axis.

    `information`: Σ(I - d dᵀ) over unit directions (Shuster and Oh 1981). `variance`: of one
    component of a residual, estimated with `freedom` degrees; its own uncertainty is counted by the
    F distribution. Infinite if something is not determined.
    """
    weakest = float(np.linalg.eigvalsh(information)[0])
    if weakest <= 1e-12 or freedom < 1:
        return math.inf
    spread = 3 * float(stats.f.ppf(CONFIDENCE, 3, freedom))
    return math.sqrt(spread * variance / weakest)


OUTLIER_DEG = 10.0
GOOD_DEG = 2.0  # an error bound up to here needs no second thought
BAD_DEG = 3.0  # ... and from here on the result is no use
_REVERSED_DEG = 135.0


@dataclass(frozen=True, slots=True, eq=False)
class StrokeResult:
    """How one stroke fits the frame."""

    line: StrokeLine
    angle_deg: float  # between the fitted direction and the prompted axis
    used: bool
    remark: str  # why it was left out, "" if it was not


@dataclass(frozen=True, slots=True, eq=False)
class FrameFit:
    """`rotation` takes the tracking frame to the arm's base frame, shape (3, 3)."""

    rotation: Matrix
    error_bound_deg: float  # 95 %, from how the strokes disagree with each other
    residual_mm: float  # RMS distance of the samples from the lines that the frame predicts
    strokes: tuple[StrokeResult, ...]

    @property
    def left_out(self) -> tuple[str, ...]:
        return tuple(stroke.remark for stroke in self.strokes if not stroke.used)


def fit_strokes(strokes: Sequence[Stroke]) -> FrameFit:
    """The frame from one to six strokes along each axis; RefusedError says what to do instead."""
    lines = [fit_line(stroke) for stroke in strokes]
    for line in lines:
        check_line(line)
    measured = np.array([line.direction for line in lines])
    wanted = np.eye(3)[[line.axis for line in lines]]
    used = _consensus(lines, measured, wanted)
    covered = {line.axis for line, use in zip(lines, used, strict=True) if use}
    if len(covered) < len(AXES):
        raise diagnose(_typical_directions(lines))
    rotation = kabsch(measured[used], wanted[used])
    angles = angles_deg(rotation, measured, wanted)
    return FrameFit(
        rotation,
        _error_bound_deg(angles[used], wanted[used], [lines[n] for n in np.flatnonzero(used)]),
        _residual_mm(rotation, strokes, lines, used),
        tuple(
            StrokeResult(line, float(angle), bool(use), "" if use else _remark(line, angle))
            for line, angle, use in zip(lines, angles, used, strict=True)
        ),
    )


def _consensus(lines: Sequence[StrokeLine], measured: Matrix, wanted: Matrix) -> Matrix:
    """Which strokes agree, shape (n,) of bool; an axis without any cannot be helped here."""
    of_axis = [[n for n, line in enumerate(lines) if line.axis == axis] for axis in range(3)]
    best, best_cost = np.zeros(len(lines), dtype=bool), math.inf
    for pick in product(*of_axis):
        chosen = list(pick)
        angles = angles_deg(kabsch(measured[chosen], wanted[chosen]), measured, wanted)
        cost = float((np.minimum(angles, OUTLIER_DEG) ** 2).sum())
        if cost < best_cost:
            best, best_cost = angles <= OUTLIER_DEG, cost
    return np.asarray(best)


def _typical_directions(lines: Sequence[StrokeLine]) -> Matrix:
    """For each axis the stroke that is nearest to the others of its axis, rows of shape (3, 3)."""
    rows = []
    for axis in range(3):
        own = np.array([line.direction for line in lines if line.axis == axis])
        rows.append(own[np.argmax((own @ own.T).sum(axis=1))])
    return np.array(rows)


def _error_bound_deg(angles: Matrix, wanted: Matrix, lines: Sequence[StrokeLine]) -> float:
    """Never below what the scatter within the strokes alone explains."""
    freedom = 2 * len(angles) - 3
    between = float((np.radians(angles) ** 2).sum()) / freedom
    # a line through n samples spread evenly over its length: σ √(12/n) / L
    within = float(
        np.mean([12 * (line.scatter_m / line.length_m) ** 2 / line.samples for line in lines])
    )
    information = np.eye(3) * len(wanted) - wanted.T @ wanted
    return math.degrees(bound_rad(information, max(between, within), freedom))


def _residual_mm(
    rotation: Matrix, strokes: Sequence[Stroke], lines: Sequence[StrokeLine], used: Matrix
) -> float:
    squares, count = 0.0, 0
    for stroke, line, use in zip(strokes, lines, used, strict=True):
        if use:
            offset = stroke.positions[line.kept] - line.centre
            along = offset @ rotation[line.axis]
            squares += float((offset**2).sum() - (along**2).sum())
            count += len(offset)
    return 1000 * math.sqrt(max(0.0, squares) / count)


def _remark(line: StrokeLine, angle: float) -> str:
    if angle > _REVERSED_DEG:
        return f"one {line.name} stroke went the other way and is left out"
    return f"one {line.name} stroke was {angle:.0f}° from the others and is left out"


PARALLEL_DEG = 45.0
_UP = np.array([0.0, 1.0, 0.0])  # of the tracking frame: OpenVR's standing universe
_UPRIGHT_DEG = 25.0
_SQUARE_DEG = 10.0


def diagnose(directions: Matrix) -> RefusedError:
    """Why `directions` (rows: of the +x, +y, +z strokes, unit) make no frame.

    A mirrored triple does not say which of its strokes was wrong: any one reversed, or any two
    taken for one another, gives the same.
    """
    pairs = list(combinations(range(3), 2))
    cosines = [
        np.clip(directions[first] @ directions[second], -1.0, 1.0) for first, second in pairs
    ]
    angles = [math.degrees(math.acos(cosine)) for cosine in cosines]
    names = [f"The +{AXES[first]} and +{AXES[second]} strokes" for first, second in pairs]
    for pair, angle in zip(names, angles, strict=True):
        if not PARALLEL_DEG <= angle <= 180 - PARALLEL_DEG:
            ways = "nearly the same way" if angle < 90 else "nearly opposite ways"
            return RefusedError(
                f"{pair} went {ways} ({angle:.0f}° apart, and it should be 90): "
                "make both again, each along its own axis of the robot."
            )
    if np.linalg.det(directions) < 0:
        return RefusedError(
            "The strokes make a mirrored frame: one went the other way, or two axes were taken for "
            "one another; make them all again, each as prompted."
        )
    worst, pair = max((abs(90 - angle), pair) for pair, angle in zip(names, angles, strict=True))
    if worst < _SQUARE_DEG:
        return RefusedError(
            "Strokes along the same axis went different ways: make them all again, as prompted."
        )
    return RefusedError(
        f"{pair} are {worst:.0f}° from a right angle: "
        "make both again, along edges that are square to each other."
    )


def stands_upright(rotation: Matrix) -> bool:
    """Whether the robot's z axis points up in a tracking frame whose y axis does."""
    return bool(rotation[2] @ _UP > math.cos(math.radians(_UPRIGHT_DEG)))
