"""What a person most likely did wrong when three directions are no frame."""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from calibration.frame.rotation import Matrix, kabsch, turn_deg
from calibration.frame.stroke import AXES, Reason, RefusedError

PARALLEL_DEG = 45.0
_UP = np.array([0.0, 1.0, 0.0])  # of the tracking frame: OpenVR's standing universe
_UPRIGHT_DEG = 25.0
_SQUARE_DEG = 10.0
_NEAR_DEG = 30.0  # of the rotation in force


@dataclass(frozen=True, slots=True, eq=False)
class _Mistake:
    """One thing that turns a frame into a mirrored one, and the frame without it."""

    sentence: str
    rotation: Matrix


def diagnose(directions: Matrix, present: Matrix | None) -> RefusedError:
    """Why `directions` (rows: of the +x, +y, +z strokes, unit) make no frame.

    A mirrored triple does not say which of its strokes was wrong: any one reversed, or any two
    taken for one another, gives the same. What decides is the rotation in force, where one of these
    mistakes explains the difference from it, and else that robots mostly stand upright; where
    neither decides, all that is possible is said.
    """
    for first, second in combinations(range(3), 2):
        angle = math.degrees(math.acos(np.clip(directions[first] @ directions[second], -1.0, 1.0)))
        pair = f"The +{AXES[first]} and +{AXES[second]} strokes"
        if not PARALLEL_DEG <= angle <= 180 - PARALLEL_DEG:
            ways = "nearly the same way" if angle < 90 else "nearly opposite ways"
            return RefusedError(
                Reason.NOT_INDEPENDENT,
                f"{pair} went {ways} ({angle:.0f}° apart, and it should be 90): "
                "make both again, each along its own axis of the robot.",
            )
    if np.linalg.det(directions) < 0:
        return RefusedError(Reason.MIRRORED, _mirrored(directions, present))
    angles = [
        (abs(90 - math.degrees(math.acos(np.clip(directions[i] @ directions[j], -1.0, 1.0)))), i, j)
        for i, j in combinations(range(3), 2)
    ]
    worst, first, second = max(angles)
    if worst < _SQUARE_DEG:
        return RefusedError(
            Reason.CONTRADICTORY,
            "Strokes along the same axis went different ways: make them all again, as prompted.",
        )
    return RefusedError(
        Reason.SKEWED,
        f"The +{AXES[first]} and +{AXES[second]} strokes are {worst:.0f}° from a right angle: "
        "make both again, along edges that are square to each other.",
    )


def stands_upright(rotation: Matrix) -> bool:
    """Whether the robot's z axis points up in a tracking frame whose y axis does."""
    return bool(rotation[2] @ _UP > math.cos(math.radians(_UPRIGHT_DEG)))


def _mirrored(directions: Matrix, present: Matrix | None) -> str:
    likely = _likeliest(_mistakes(directions), present)
    said = " or ".join(mistake.sentence for mistake in likely)
    if len(likely) == 1:
        return f"The strokes make a mirrored frame: most likely {said}; make it again."
    return f"The strokes make a mirrored frame: {said}; make them all again, each as prompted."


def _mistakes(directions: Matrix) -> list[_Mistake]:
    found = []
    for axis, name in enumerate(AXES):
        mended = directions.copy()
        mended[axis] = -mended[axis]
        found.append(_Mistake(f"the +{name} stroke was reversed", kabsch(mended, np.eye(3))))
    for first, second in combinations(range(3), 2):
        mended = directions.copy()
        mended[[first, second]] = mended[[second, first]]
        sentence = f"+{AXES[first]} and +{AXES[second]} were taken for one another"
        found.append(_Mistake(sentence, kabsch(mended, np.eye(3))))
    return found


def _likeliest(mistakes: list[_Mistake], present: Matrix | None) -> list[_Mistake]:
    upright = [one for one in mistakes if stands_upright(one.rotation)]
    if present is not None:
        near = [one for one in mistakes if turn_deg(one.rotation, present) < _NEAR_DEG]
        if near:
            return near
    return upright or mistakes
