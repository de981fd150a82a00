"""Strokes and touches until they make a frame: more rounds, or all anew."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np

from calibration.desk import Desk
from calibration.frame.asking import ask_stroke, ask_touches, wait_for_a_steady_frame
from calibration.frame.fit import GOOD_DEG, FrameFit, fit_strokes
from calibration.frame.reasons import Reason, RefusedError
from calibration.frame.sources import HandSource
from calibration.frame.stroke import AXES, Stroke
from calibration.frame.touches import TouchFit, fit_touches
from tams_app.config import Config
from tams_app.records import Vector

MOST_ROUNDS = 4
_BEGINNINGS = 3  # of everything, when what was measured makes no frame together
Fit = TypeVar("Fit", FrameFit, TouchFit)


def fit_moves(desk: Desk, source: HandSource, config: Config, rounds: int) -> FrameFit:
    """Rounds of three strokes, more while that helps; all anew when they make no frame."""
    return _anew(desk, source, lambda: _fit_rounds(desk, source, config, rounds))


def fit_touched(
    desk: Desk, source: HandSource, config: Config, points: Sequence[Vector]
) -> TouchFit:
    """Touches of all points; all anew when they make no frame, unless the list is wrong."""
    return _anew(desk, source, lambda: fit_touches(ask_touches(desk, source, config, points)))


def _anew(desk: Desk, source: HandSource, once: Callable[[], Fit]) -> Fit:
    for beginning in range(_BEGINNINGS):
        try:
            return once()
        except RefusedError as error:
            if beginning == _BEGINNINGS - 1 or error.reason is Reason.IMPOSSIBLE_SCALE:
                raise
            desk.say(f"{error}\nFrom the beginning, then.")
            wait_for_a_steady_frame(source)
    raise AssertionError("the last beginning returns or raises")


def _fit_rounds(desk: Desk, source: HandSource, config: Config, rounds: int) -> FrameFit:
    present = np.array(config.hand.rotation)
    strokes: list[Stroke] = []
    for number in range(1, max(rounds, MOST_ROUNDS) + 1):
        desk.say(f"Round {number}.")
        strokes += [ask_stroke(desk, source, config, axis) for axis in range(len(AXES))]
        if number < rounds:
            continue
        fit = fit_strokes(strokes, present)
        if fit.error_bound_deg <= GOOD_DEG or number >= MOST_ROUNDS:
            return fit
        desk.say(f"So far the frame may be off by {fit.error_bound_deg:.1f}°.")
    raise AssertionError("the last round returns or raises")
