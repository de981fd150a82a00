"""The parts of the conversation: press, move, touch, try. Each repeats what did not go well."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TypeVar

from calibration.desk import Desk
from calibration.frame import shown
from calibration.frame.buttons import ButtonFinding, PressWatch, settle
from calibration.frame.capture import Capture, Held, touch_of
from calibration.frame.compass import Compass
from calibration.frame.prompts import SIX_WAYS, Move, Press, Reach
from calibration.frame.reasons import Reason, RefusedError
from calibration.frame.recorded import MIN_TRAVEL_M, travel_m
from calibration.frame.sources import ButtonSource, HandSource
from calibration.frame.stroke import Stroke, check_line, fit_line
from calibration.frame.touches import Touch
from hw.openvr.components import ROLES, configured_role_map
from tams_app.config import Config, HandConfig
from tams_app.records import ControllerSample, ControllerStatus, Vector

ATTEMPTS = 5  # of one stroke, touch or button
TRIES = 3  # of one direction: people take left for right
SHOW_EVERY = 12  # samples: ten times a second

Result = TypeVar("Result")
Show = Callable[[Held | None, ControllerSample], None]


def ask_buttons(desk: Desk, source: ButtonSource, config: Config) -> ButtonFinding:
    """Every part pressed once; begun anew when a component comes for two of them."""
    for attempt in range(ATTEMPTS):
        try:
            return _press_all(desk, source, config)
        except RefusedError as error:
            if attempt == ATTEMPTS - 1 or error.reason is not Reason.WRONG_BUTTON:
                raise
            desk.say(f"{error} All the buttons once more.")
    raise AssertionError("the last attempt returns or raises")


def ask_stroke(desk: Desk, source: HandSource, config: Config, axis: int) -> Stroke:
    """One good stroke along the robot's axis."""
    way = Move(axis)
    desk.say(f"Hold the trigger, move along the robot's {way.name} ({shown.meaning(way)}), let go.")

    def show(held: Held | None, sample: ControllerSample) -> None:
        desk.show(shown.stroke_line(axis, held, sample))

    def once() -> Stroke:
        source.ask(way)
        stroke = Stroke(axis, _hold(source, config, show).positions)
        check_line(fit_line(stroke))
        return stroke

    return _repeated(desk, once)


def ask_touches(
    desk: Desk, source: HandSource, config: Config, points: Sequence[Vector]
) -> list[Touch]:
    """One good touch of each point [m]."""
    return [
        _ask_touch(desk, source, config, Reach(point, number))
        for number, point in enumerate(points, start=1)
    ]


def wait_for_a_steady_frame(source: HandSource) -> None:
    """Until the controller no longer says that its tracking frame has changed."""
    while source.next()[1].status is ControllerStatus.TRACKING_FRAME_CHANGED:
        pass


def try_six_ways(
    desk: Desk, source: HandSource, config: Config, hand: HandConfig
) -> dict[Move, bool]:
    """Whether each direction lit up when it was asked for; those that Enter skipped are missing."""
    right: dict[Move, bool] = {}
    for way in SIX_WAYS:
        desk.say(f"Hold the trigger, move along {way.name} ({shown.meaning(way)}), let go.")
        for left in reversed(range(TRIES)):
            wrong = _try_way(desk, source, config, hand, way, right)
            if wrong is None:
                right.pop(way, None)
                break
            right[way] = not wrong
            if not wrong:
                break
            desk.say(wrong + (" Once more." if left else ""))
    desk.say(shown.as_text(shown.compass_table(None, None, right)))
    return right


def _try_way(
    desk: Desk,
    source: HandSource,
    config: Config,
    hand: HandConfig,
    way: Move,
    right: Mapping[Move, bool],
) -> str | None:
    """What was wrong with one try of a direction, "" for nothing; None if Enter skipped it."""
    capture, compass = Capture(config), Compass(config, hand)
    source.ask(way)
    count, done = 0, None
    while done is None or travel_m(done) < MIN_TRAVEL_M:
        now_ns, sample = source.next()
        try:
            done = capture.take(sample, now_ns)
        except RefusedError as error:
            if error.reason is Reason.FRAME_CHANGED:
                raise
            return str(error)
        compass.update(sample, now_ns, held=capture.so_far is not None)
        count += 1
        if count % SHOW_EVERY == 0:
            desk.show(shown.compass_table(way, compass.lit, right))
            if desk.pressed():
                return None
    lit = compass.mostly()
    if lit is None:
        return f"Nothing lit up when {way.name} was asked for: move faster, and straight."
    return "" if lit == way else f"{lit.name} lit up when {way.name} was asked for."


def _press_all(desk: Desk, source: ButtonSource, config: Config) -> ButtonFinding:
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
                desk.show(shown.button_table(reading, role, found))
        return path

    for role in ROLES:
        desk.say(f"Press and let go {shown.PARTS[role]}.")
        found[role] = _repeated(desk, partial(once, role))
    hand = config.controller.hand
    mapped = configured_role_map(kind, hand, config.controller)
    return settle(kind, hand, found, {role: mapped[role].path for role in ROLES})


def _ask_touch(desk: Desk, source: HandSource, config: Config, point: Reach) -> Touch:
    place = ", ".join(f"{1000 * value:.0f}" for value in point.robot)
    desk.say(f"Touch point {point.number} ({place} mm), squeeze the trigger, wait, let go.")

    def show(held: Held | None, sample: ControllerSample) -> None:
        desk.show(shown.touch_line(point.number, held, sample))

    def once() -> Touch:
        source.ask(point)
        return touch_of(_hold(source, config, show), point.robot, point.number)

    return _repeated(desk, once)


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


def _repeated(desk: Desk, once: Callable[[], Result]) -> Result:
    """Until it goes well; what no repetition mends, and the last failure, is raised."""
    for left in reversed(range(ATTEMPTS)):
        try:
            return once()
        except RefusedError as error:
            if left == 0 or error.reason in (Reason.FRAME_CHANGED, Reason.WRONG_BUTTON):
                raise
            desk.say(str(error))
    raise AssertionError("the last attempt returns or raises")
