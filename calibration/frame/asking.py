"""The parts of the conversation: press, move, touch. Each repeats what did not go well."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from typing import TypeVar

import numpy as np

from calibration.frame import display
from calibration.frame.buttons import ButtonFinding, PressWatch, settle
from calibration.frame.capture import Capture, Held, touch_of
from calibration.frame.fit import GOOD_DEG, FrameFit, fit_strokes
from calibration.frame.sources import SHOW_EVERY, ButtonSource, HandSource, Move, Press, Reach
from calibration.frame.stroke import AXES, Reason, RefusedError, Stroke, check_line, fit_line
from calibration.frame.touches import Touch, TouchFit, fit_touches
from calibration.ui import WizardUI
from hw.openvr.components import ROLES, configured_role_map
from tams_app.config import Config
from tams_app.records import ControllerSample, ControllerStatus, Vector

ATTEMPTS = 5  # of one stroke, touch or button
MOST_ROUNDS = 4
_BEGINNINGS = 3  # of everything, when what was measured makes no frame together

Result = TypeVar("Result")
Fit = TypeVar("Fit", FrameFit, TouchFit)
Show = Callable[[Held | None, ControllerSample], None]


def ask_buttons(ui: WizardUI, source: ButtonSource, config: Config) -> ButtonFinding:
    """Every part pressed once; begun anew when a component comes for two of them."""
    for attempt in range(ATTEMPTS):
        try:
            return _press_all(ui, source, config)
        except RefusedError as error:
            if attempt == ATTEMPTS - 1 or error.reason is not Reason.WRONG_BUTTON:
                raise
            ui.say(f"{error} All the buttons once more.")
    raise AssertionError("the last attempt returns or raises")


def ask_stroke(ui: WizardUI, source: HandSource, config: Config, axis: int) -> Stroke:
    """One good stroke along the robot's axis."""
    move = Move(axis)
    ui.say(
        f"Hold the trigger, move along the robot's {move.name} ({display.meaning(move)}), let go."
    )

    def show(held: Held | None, sample: ControllerSample) -> None:
        ui.show(display.stroke_line(axis, held, sample))

    def once() -> Stroke:
        source.ask(move)
        stroke = Stroke(axis, _hold(source, config, show).positions)
        check_line(fit_line(stroke))
        return stroke

    return _repeated(ui, once)


def ask_touches(
    ui: WizardUI, source: HandSource, config: Config, points: Sequence[Vector]
) -> list[Touch]:
    """One good touch of each point [m]."""
    return [
        _ask_touch(ui, source, config, Reach(point, number))
        for number, point in enumerate(points, start=1)
    ]


def wait_for_a_steady_frame(source: HandSource) -> None:
    """Until the controller no longer says that its tracking frame has changed."""
    while source.next()[1].status is ControllerStatus.TRACKING_FRAME_CHANGED:
        pass


def _press_all(ui: WizardUI, source: ButtonSource, config: Config) -> ButtonFinding:
    found: dict[str, str] = {}
    kind = ""

    def once(role: str) -> str:
        nonlocal kind
        source.ask(Press(role))
        watch = PressWatch(role, {path: taken for taken, path in found.items()})
        path, count = None, 0
        while path is None:
            now_ns, reading = source.next()
            kind = reading.controller_type if reading else kind
            path = watch.take(reading, now_ns)
            count += 1
            if count % SHOW_EVERY == 0:
                ui.show(display.button_table(reading, role, found))
        return path

    for role in ROLES:
        ui.say(f"Press and let go {display.PARTS[role]}.")
        found[role] = _repeated(ui, partial(once, role))
    hand = config.controller.hand
    mapped = configured_role_map(kind, hand, config.controller)
    return settle(kind, hand, found, {role: mapped[role].path for role in ROLES})


def _ask_touch(ui: WizardUI, source: HandSource, config: Config, point: Reach) -> Touch:
    place = ", ".join(f"{1000 * value:.0f}" for value in point.robot)
    ui.say(f"Touch point {point.number} ({place} mm), squeeze the trigger, wait, let go.")

    def show(held: Held | None, sample: ControllerSample) -> None:
        ui.show(display.touch_line(point.number, held, sample))

    def once() -> Touch:
        source.ask(point)
        return touch_of(_hold(source, config, show), point.robot, point.number)

    return _repeated(ui, once)


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


def _repeated(ui: WizardUI, once: Callable[[], Result]) -> Result:
    """Until it goes well; what no repetition mends, and the last failure, is raised."""
    for left in reversed(range(ATTEMPTS)):
        try:
            return once()
        except RefusedError as error:
            if left == 0 or error.reason in (Reason.FRAME_CHANGED, Reason.WRONG_BUTTON):
                raise
            ui.say(str(error))
    raise AssertionError("the last attempt returns or raises")


def fit_moves(ui: WizardUI, source: HandSource, config: Config, rounds: int) -> FrameFit:
    """Rounds of three strokes, more while that helps; all anew when they make no frame."""
    return _anew(ui, source, lambda: _fit_rounds(ui, source, config, rounds))


def fit_touched(
    ui: WizardUI, source: HandSource, config: Config, points: Sequence[Vector]
) -> TouchFit:
    """Touches of all points; all anew when they make no frame, unless the list is wrong."""
    return _anew(ui, source, lambda: fit_touches(ask_touches(ui, source, config, points)))


def _anew(ui: WizardUI, source: HandSource, once: Callable[[], Fit]) -> Fit:
    for beginning in range(_BEGINNINGS):
        try:
            return once()
        except RefusedError as error:
            if beginning == _BEGINNINGS - 1 or error.reason is Reason.IMPOSSIBLE_SCALE:
                raise
            ui.say(f"{error}\nFrom the beginning, then.")
            wait_for_a_steady_frame(source)
    raise AssertionError("the last beginning returns or raises")


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
