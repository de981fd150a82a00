"""Strokes and the six directions, as the person is asked for them.

What did not go well is repeated. No arm is connected: the six directions show where teleoperation
would send it.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable, Mapping
from functools import partial
from typing import TypeVar

import numpy as np
from rich.table import Table
from rich.text import Text

from calibration.frame.fit import (
    ASKED_LENGTH_M,
    AXES,
    GOOD_DEG,
    MIN_SAMPLES,
    BeginAgainError,
    FrameFit,
    Matrix,
    RefusedError,
    Stroke,
    check_line,
    fit_line,
    fit_strokes,
)
from calibration.frame.sources import (
    SHOW_EVERY,
    SIX_DIRECTIONS,
    HandSource,
    Move,
    StrokeCapture,
)
from calibration.kit import WizardUI, as_text, bar, table
from tams_app.config import Config, HandConfig
from tams_app.errors import TamsError
from tams_app.records import ControllerSample, ControllerStatus
from tams_app.teleop.motion import HandMotion

ATTEMPTS = 5  # of one stroke or button
MOST_ROUNDS = 4
_ATTEMPTS_OF_ALL = 3  # of everything, when what was measured makes no frame together

Result = TypeVar("Result")


def ask_stroke(ui: WizardUI, source: HandSource, config: Config, axis: int) -> Stroke:
    """One good stroke along the robot's axis."""
    move = Move(axis)
    ui.print(f"Hold the trigger, move along the robot's {move.name} ({move.meaning}), let go.")

    def once() -> Stroke:
        stroke = Stroke(axis, _held(ui, source, config, move))
        check_line(fit_line(stroke))
        return stroke

    return repeated(ui, once)


def _held(ui: WizardUI, source: HandSource, config: Config, prompt: Move) -> Matrix:
    """Ask for it, and wait until the trigger has been held and released; shows what there is."""
    source.ask(prompt)
    capture, count = StrokeCapture(config), 0
    while True:
        now_ns, sample = source.next()
        held = capture.take(sample, now_ns)
        if held is not None:
            return held
        count += 1
        if count % SHOW_EVERY == 0:
            rows = _progress(prompt, capture.so_far)
            ui.show(table([("controller", sample.status.value), *rows]))


def _progress(prompt: Move, held: Matrix | None) -> list[tuple[str, str]]:
    """What there is of a stroke, name and value; None while the trigger is up."""
    if held is None:
        return [("trigger", "up: squeeze it to begin")]
    try:
        line = fit_line(Stroke(prompt.axis, held))
    except RefusedError:  # too few samples to say anything yet
        return [("trigger", "held: move")]
    return [
        ("travel", f"{bar(line.length_m / ASKED_LENGTH_M)} {1000 * line.length_m:.0f} mm"),
        ("straightness", f"{bar(line.straightness)} {line.straightness:.0%}"),
        ("samples", f"{bar(line.samples / MIN_SAMPLES)} {line.samples}"),
    ]


def repeated(
    ui: WizardUI,
    once: Callable[[], Result],
    attempts: int = ATTEMPTS,
    mended: tuple[type[TamsError], ...] = (RefusedError,),
    then: str = "",
    steady: HandSource | None = None,
) -> Result:
    """One measurement, repeated until it goes well; each refusal is printed, and `then` after it.

    `mended`: the refusals that another attempt can mend; the last attempt's is raised.
    `steady`: until its tracking frame no longer changes, no other attempt begins.
    """
    for left in reversed(range(attempts)):
        try:
            return once()
        except mended as error:
            if left == 0:
                raise
            ui.print(f"{error}{then}")
        if steady is not None:
            while steady.next()[1].status is ControllerStatus.TRACKING_FRAME_CHANGED:
                pass
    raise AssertionError("the last attempt returns or raises")


def fit_moves(ui: WizardUI, source: HandSource, config: Config, rounds: int) -> FrameFit:
    """Rounds of three strokes, more while that helps; all anew when they make no frame."""
    return repeated(
        ui,
        partial(_fit_rounds, ui, source, config, rounds),
        _ATTEMPTS_OF_ALL,
        (RefusedError, BeginAgainError),
        "\nFrom the beginning, then.",
        source,
    )


def _fit_rounds(ui: WizardUI, source: HandSource, config: Config, rounds: int) -> FrameFit:
    strokes: list[Stroke] = []
    for number in range(1, max(rounds, MOST_ROUNDS) + 1):
        ui.print(f"Round {number}.")
        strokes += [ask_stroke(ui, source, config, axis) for axis in range(len(AXES))]
        if number < rounds:
            continue
        fit = fit_strokes(strokes)
        if fit.error_bound_deg <= GOOD_DEG or number >= MOST_ROUNDS:
            return fit
        ui.print(f"So far the frame may be off by {fit.error_bound_deg:.1f}°.")
    raise AssertionError("the last round returns or raises")


_ARROWS = {"+x": "⊙", "−x": "⊗", "+y": "←", "−y": "→", "+z": "↑", "−z": "↓"}
MIN_TRAVEL_M = 0.060  # from the first place: less is a squeeze of the trigger, no stroke
MIN_SPEED_M_S = 0.04  # of the hand: slower, no direction is lit
MAX_OFF_AXIS_DEG = 30.0
TRIES_PER_DIRECTION = 3  # of one direction: people take left for right


def try_six_directions(
    ui: WizardUI, source: HandSource, config: Config, hand: HandConfig
) -> dict[Move, bool]:
    """Whether each direction lit up when it was asked for; those that Enter skipped are missing."""
    right: dict[Move, bool] = {}
    for wanted in SIX_DIRECTIONS:
        ui.print(f"Hold the trigger, move along {wanted.name} ({wanted.meaning}), let go.")
        for left in reversed(range(TRIES_PER_DIRECTION)):
            wrong = _try_direction(ui, source, config, hand, wanted, right)
            if wrong is None:
                right.pop(wanted, None)
                break
            right[wanted] = not wrong
            if not wrong:
                break
            ui.print(wrong + (" Once more." if left else ""))
    ui.print(as_text(_compass_table(None, None, right)))
    return right


def _try_direction(
    ui: WizardUI,
    source: HandSource,
    config: Config,
    hand: HandConfig,
    wanted: Move,
    right: Mapping[Move, bool],
) -> str | None:
    """What was wrong with one try of a direction, "" for nothing; None if Enter skipped it."""
    capture, compass = StrokeCapture(config), Compass(config, hand)
    source.ask(wanted)
    count, done = 0, None
    while done is None or np.linalg.norm(done - done[:1], axis=1).max(initial=0.0) < MIN_TRAVEL_M:
        now_ns, sample = source.next()
        try:
            done = capture.take(sample, now_ns)
        except RefusedError as error:
            return str(error)
        compass.update(sample, now_ns, held=capture.so_far is not None)
        count += 1
        if count % SHOW_EVERY == 0:
            ui.show(_compass_table(wanted, compass.lit, right))
            if ui.pressed():
                return None
    lit = compass.mostly()
    if lit is None:
        return f"Nothing lit up when {wanted.name} was asked for: move faster, and straight."
    return "" if lit == wanted else f"{lit.name} lit up when {wanted.name} was asked for."


def _compass_table(asked: Move | None, lit: Move | None, right: Mapping[Move, bool]) -> Table:
    """The six directions: which one is asked for, which one the arm would take now."""
    rows = []
    for move in SIX_DIRECTIONS:
        style = "bold black on green" if move == lit else "" if move == asked else "dim"
        name = Text(f" {_ARROWS[move.name]} {move.name} ", style)
        verdict = {True: "✓", False: "✗", None: ""}[right.get(move)]
        rows.append(("▶" if move == asked else " ", name, move.meaning, verdict))
    return table(rows)


class Compass:
    """Lights the direction that teleoperation would send the arm in."""

    def __init__(self, config: Config, hand: HandConfig) -> None:
        """`hand`: the mapping to be tried."""
        self._motion = HandMotion(hand, config.freshness.pose_frozen_ms * 1e6)
        self._scale = hand.translation_scale
        self._last_ns: int | None = None
        self.lit: Move | None = None
        self._seen: Counter[Move] = Counter()

    def update(self, sample: ControllerSample, now_ns: int, held: bool) -> None:
        """Light the direction of now; those lit while the trigger is `held` are counted."""
        if self._last_ns is None:
            self._motion.anchor(sample)
            self._last_ns = now_ns
        interval_s = (now_ns - self._last_ns) / 1e9
        self._last_ns = now_ns
        twist = self._motion.update(sample, now_ns, interval_s)
        self.lit = direction_of(np.array(twist.linear) / self._scale)
        if held and self.lit is not None:
            self._seen[self.lit] += 1

    def mostly(self) -> Move | None:
        """The direction that was lit longest since this was last asked."""
        most = self._seen.most_common(1)
        self._seen.clear()
        return most[0][0] if most else None


def direction_of(velocity: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> Move | None:
    """The robot's axis that a velocity [m/s] goes along within 30°, None for none."""
    speed = float(np.linalg.norm(velocity))
    if speed < MIN_SPEED_M_S:
        return None
    best = max(SIX_DIRECTIONS, key=lambda wanted: float(wanted.direction @ velocity))
    share = float(best.direction @ velocity) / speed
    return best if share >= math.cos(math.radians(MAX_OFF_AXIS_DEG)) else None
