"""Strokes and touches as the person is asked for them; what did not go well is repeated."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import TypeVar

import numpy as np
from rich.table import Table

from calibration.frame.capture import Capture, Held, touch_of
from calibration.frame.fit import GOOD_DEG, FrameFit, fit_strokes
from calibration.frame.sources import SHOW_EVERY, HandSource, Move, Reach
from calibration.frame.stroke import (
    ASKED_LENGTH_M,
    AXES,
    MIN_SAMPLES,
    Reason,
    RefusedError,
    Stroke,
    check_line,
    fit_line,
)
from calibration.frame.touches import Touch, TouchFit, fit_touches
from calibration.ui import WizardUI, bar
from tams_app.config import Config
from tams_app.records import ControllerSample, ControllerStatus, Vector

ATTEMPTS = 5  # of one stroke, touch or button
MOST_ROUNDS = 4
_BEGINNINGS = 3  # of everything, when what was measured makes no frame together

Result = TypeVar("Result")
Fit = TypeVar("Fit", FrameFit, TouchFit)
Show = Callable[[Held | None, ControllerSample], None]


def ask_stroke(ui: WizardUI, source: HandSource, config: Config, axis: int) -> Stroke:
    """One good stroke along the robot's axis."""
    move = Move(axis)
    ui.say(f"Hold the trigger, move along the robot's {move.name} ({move.meaning}), let go.")

    def show(held: Held | None, sample: ControllerSample) -> None:
        ui.show(_stroke_table(axis, held, sample))

    def once() -> Stroke:
        source.ask(move)
        stroke = Stroke(axis, _hold(source, config, show).positions)
        check_line(fit_line(stroke))
        return stroke

    return ask_again(ui, once)


def ask_touches(
    ui: WizardUI, source: HandSource, config: Config, points: Sequence[Vector]
) -> list[Touch]:
    """One good touch of each point [m]."""
    return [
        _ask_touch(ui, source, config, Reach(point, number))
        for number, point in enumerate(points, start=1)
    ]


def _ask_touch(ui: WizardUI, source: HandSource, config: Config, point: Reach) -> Touch:
    place = ", ".join(f"{1000 * value:.0f}" for value in point.robot)
    ui.say(f"Touch point {point.number} ({place} mm), squeeze the trigger, wait, let go.")

    def show(held: Held | None, sample: ControllerSample) -> None:
        ui.show(_touch_table(point.number, held, sample))

    def once() -> Touch:
        source.ask(point)
        return touch_of(_hold(source, config, show), point.robot, point.number)

    return ask_again(ui, once)


def _hold(source: HandSource, config: Config, show: Show) -> Held:
    """Wait until the trigger has been held and let go."""
    capture, count = Capture(config), 0
    while True:
        now_ns, sample = source.next()
        held = capture.take(sample, now_ns)
        if held is not None:
            return held
        count += 1
        if count % SHOW_EVERY == 0:
            show(capture.so_far, sample)


def repeated(
    once: Callable[[], Result],
    attempts: int,
    mended_by: Callable[[Reason], bool],
    again: Callable[[RefusedError], None],
) -> Result:
    """Until it goes well, with `again` before each repetition.

    RefusedError: The last one, or one whose reason is not `mended_by` another attempt.
    """
    for left in reversed(range(attempts)):
        try:
            return once()
        except RefusedError as error:
            if left == 0 or not mended_by(error.reason):
                raise
            again(error)
    raise AssertionError("the last attempt returns or raises")


def ask_again(ui: WizardUI, once: Callable[[], Result]) -> Result:
    """One measurement, repeated until it goes well."""
    return repeated(
        once,
        ATTEMPTS,
        lambda reason: reason not in (Reason.FRAME_CHANGED, Reason.WRONG_BUTTON),
        lambda error: ui.say(str(error)),
    )


def fit_moves(ui: WizardUI, source: HandSource, config: Config, rounds: int) -> FrameFit:
    """Rounds of three strokes, more while that helps; all anew when they make no frame."""
    return _anew(ui, source, lambda: _fit_rounds(ui, source, config, rounds))


def fit_touched(
    ui: WizardUI, source: HandSource, config: Config, points: Sequence[Vector]
) -> TouchFit:
    """Touches of all points; all anew when they make no frame, unless the list is wrong."""
    return _anew(ui, source, lambda: fit_touches(ask_touches(ui, source, config, points)))


def _anew(ui: WizardUI, source: HandSource, once: Callable[[], Fit]) -> Fit:
    def again(error: RefusedError) -> None:
        ui.say(f"{error}\nFrom the beginning, then.")
        while source.next()[1].status is ControllerStatus.TRACKING_FRAME_CHANGED:
            pass  # until the new frame is steady

    return repeated(once, _BEGINNINGS, lambda reason: reason is not Reason.IMPOSSIBLE_SCALE, again)


def _fit_rounds(ui: WizardUI, source: HandSource, config: Config, rounds: int) -> FrameFit:
    present = np.array(config.hand.rotation)
    strokes: list[Stroke] = []
    for number in range(1, max(rounds, MOST_ROUNDS) + 1):
        ui.say(f"Round {number}.")
        strokes += [ask_stroke(ui, source, config, axis) for axis in range(len(AXES))]
        if number < rounds:
            continue
        fit = fit_strokes(strokes, present)
        if fit.error_bound_deg <= GOOD_DEG or number >= MOST_ROUNDS:
            return fit
        ui.say(f"So far the frame may be off by {fit.error_bound_deg:.1f}°.")
    raise AssertionError("the last round returns or raises")


def _stroke_table(axis: int, held: Held | None, sample: ControllerSample) -> Table:
    """Travel, straightness and number of samples of the stroke under way."""
    table = Table(box=None, show_header=False)
    table.add_row("controller", sample.status.value)
    if held is None:
        table.add_row("trigger", "up: squeeze it to begin")
        return table
    try:
        line = fit_line(Stroke(axis, held.positions))
    except RefusedError:  # too few samples to say anything yet
        table.add_row("trigger", "held: move")
        return table
    table.add_row("travel", f"{bar(line.length_m / ASKED_LENGTH_M)} {1000 * line.length_m:.0f} mm")
    table.add_row("straightness", f"{bar(line.straightness)} {line.straightness:.0%}")
    table.add_row("samples", f"{bar(line.samples / MIN_SAMPLES)} {line.samples}")
    return table


def _touch_table(number: int, held: Held | None, sample: ControllerSample) -> Table:
    """Whether the touch is under way."""
    table = Table(box=None, show_header=False)
    table.add_row("controller", sample.status.value)
    samples = 0 if held is None else len(held.poses)
    table.add_row(f"point {number}", f"{samples} samples" if samples else "squeeze to begin")
    return table
