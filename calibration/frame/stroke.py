"""One stroke of the hand: the straight line through it, and why a measurement is refused."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tams_app.errors import TamsError
from tams_app.records import Vector

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
    positions: NDArray[np.float64]

    @property
    def name(self) -> str:
        return f"+{AXES[self.axis]}"


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
        raise _too_few(stroke.name, count)
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
            f"make it at least {1000 * ASKED_LENGTH_M:.0f} mm.",
        )
    if line.backtrack > MAX_BACKTRACK:
        raise RefusedError(
            f"The {line.name} stroke went back {line.backtrack * length_mm:.0f} mm: "
            "move one way, and let the trigger go at the end.",
        )
    if line.bow > MAX_BOW:
        raise RefusedError(
            f"The {line.name} stroke is bent by {line.bow * length_mm:.0f} mm over "
            f"{length_mm:.0f} mm: move along something straight, such as the table's edge.",
        )
    if line.scatter_m > MAX_SCATTER_M:
        raise RefusedError(
            f"The {line.name} stroke scatters by {1000 * line.scatter_m:.0f} mm: "
            "go to where the controller is tracked well, and move steadily.",
        )


def _median(points: NDArray[np.float64]) -> Vector:
    """The geometric median (Weiszfeld): unlike that of each axis, it turns as the points turn."""
    place = points.mean(axis=0)
    for _ in range(_MEDIAN_STEPS):
        weight = 1.0 / np.maximum(np.linalg.norm(points - place, axis=1), _SCATTER_FLOOR_M)
        place = weight @ points / weight.sum()
    return np.asarray(place)


def _sagitta(along: Vector, across: NDArray[np.float64]) -> float:
    """How far the parabola through the samples rises above its chord [m]."""
    half = float(np.ptp(along)) / 2
    if len(along) < 4 or half == 0:
        return 0.0
    basis = np.stack((np.ones_like(along), along / half, (along / half) ** 2), axis=1)
    curvature = np.linalg.lstsq(basis, across, rcond=None)[0][2]
    return float(np.linalg.norm(curvature))


def _across(offset: NDArray[np.float64], direction: Vector) -> NDArray[np.float64]:
    return np.asarray(offset - np.outer(offset @ direction, direction))


def _unit(vector: Vector) -> Vector:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0 else np.array([1.0, 0.0, 0.0])


def _too_few(name: str, count: int) -> RefusedError:
    return RefusedError(
        f"The {name} stroke has {count} samples of the {MIN_SAMPLES} it takes: "
        "move for about two seconds with the trigger held.",
    )
