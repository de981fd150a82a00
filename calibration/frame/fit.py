"""The frame from strokes along the robot's axes.

Each stroke gives a direction (see `stroke`). Of all ways to pick one stroke for each axis, the one
whose rotation agrees best with all strokes starts (truncated squares, so a wrong stroke counts no
more than a poor one); strokes more than 10° from it are left out, and the rotation is fitted to the
rest. Both as RANSAC does it, but with every pick tried.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import product

import numpy as np

from calibration.frame.diagnosis import diagnose
from calibration.frame.rotation import Matrix, angles_deg, bound_rad, condition, kabsch
from calibration.frame.stroke import AXES, Line, Reason, RefusedError, Stroke, check_line, fit_line

OUTLIER_DEG = 10.0
GOOD_DEG = 2.0  # an error bound up to here needs no second thought
BAD_DEG = 3.0  # ... and from here on the result is no use
_MOST_PER_AXIS = 6  # every pick is tried
_REVERSED_DEG = 135.0


@dataclass(frozen=True, slots=True, eq=False)
class StrokeResult:
    """How one stroke fits the frame."""

    line: Line
    angle_deg: float  # between the fitted direction and the prompted axis
    used: bool
    remark: str  # why it was left out, "" if it was not


@dataclass(frozen=True, slots=True, eq=False)
class FrameFit:
    """`rotation` takes the tracking frame to the arm's base frame, shape (3, 3)."""

    rotation: Matrix
    error_bound_deg: float  # 95 %, from how the strokes disagree with each other
    residual_mm: float  # RMS distance of the samples from the lines that the frame predicts
    condition: float  # 1: the strokes span space evenly
    strokes: tuple[StrokeResult, ...]

    @property
    def left_out(self) -> tuple[str, ...]:
        return tuple(stroke.remark for stroke in self.strokes if not stroke.used)


def fit_strokes(strokes: Sequence[Stroke], present: Matrix | None = None) -> FrameFit:
    """The frame from at least one stroke along each axis; RefusedError says what to do instead.

    `present`: the rotation in force, which only helps to guess which stroke was made wrongly.
    """
    lines = [fit_line(stroke) for stroke in strokes]
    for axis, name in enumerate(AXES):
        count = sum(line.axis == axis for line in lines)
        if count == 0:
            raise RefusedError(Reason.MISSING, f"There is no +{name} stroke: make one.")
        if count > _MOST_PER_AXIS:
            raise RefusedError(
                Reason.TOO_MANY,
                f"There are {count} +{name} strokes, and {_MOST_PER_AXIS} along each axis are the "
                "most: give fewer recordings.",
            )
    for line in lines:
        check_line(line)
    measured = np.array([line.direction for line in lines])
    wanted = np.eye(3)[[line.axis for line in lines]]
    used = _consensus(lines, measured, wanted)
    covered = {line.axis for line, use in zip(lines, used, strict=True) if use}
    if len(covered) < len(AXES):
        raise diagnose(_typical_directions(lines), present)
    rotation = kabsch(measured[used], wanted[used])
    angles = angles_deg(rotation, measured, wanted)
    return FrameFit(
        rotation,
        _error_bound_deg(angles[used], wanted[used], [lines[n] for n in np.flatnonzero(used)]),
        _residual_mm(rotation, strokes, lines, used),
        condition(measured[used]),
        tuple(
            StrokeResult(line, float(angle), bool(use), "" if use else _remark(line, angle))
            for line, angle, use in zip(lines, angles, used, strict=True)
        ),
    )


def _consensus(lines: Sequence[Line], measured: Matrix, wanted: Matrix) -> Matrix:
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


def _typical_directions(lines: Sequence[Line]) -> Matrix:
    """For each axis the stroke that is nearest to the others of its axis, rows of shape (3, 3)."""
    rows = []
    for axis in range(3):
        own = np.array([line.direction for line in lines if line.axis == axis])
        rows.append(own[np.argmax((own @ own.T).sum(axis=1))])
    return np.array(rows)


def _error_bound_deg(angles: Matrix, wanted: Matrix, lines: Sequence[Line]) -> float:
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
    rotation: Matrix, strokes: Sequence[Stroke], lines: Sequence[Line], used: Matrix
) -> float:
    squares, count = 0.0, 0
    for stroke, line, use in zip(strokes, lines, used, strict=True):
        if use:
            offset = stroke.positions[line.kept] - line.centre
            along = offset @ rotation[line.axis]
            squares += float((offset**2).sum() - (along**2).sum())
            count += len(offset)
    return 1000 * math.sqrt(max(0.0, squares) / count)


def _remark(line: Line, angle: float) -> str:
    if angle > _REVERSED_DEG:
        return f"one {line.name} stroke went the other way and is left out"
    return f"one {line.name} stroke was {angle:.0f}° from the others and is left out"
