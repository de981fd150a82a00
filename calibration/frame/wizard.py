"""`run_tams.py calibrate frame`: buttons, strokes or touches, the fit, a try, and the question."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.desk import Desk
from calibration.frame import result, shown
from calibration.frame.asking import (
    ask_buttons,
    ask_stroke,
    ask_touches,
    try_six_ways,
    wait_for_a_steady_frame,
)
from calibration.frame.buttons import ButtonFinding
from calibration.frame.fit import GOOD_DEG, FrameFit, fit_strokes
from calibration.frame.picture import save_picture
from calibration.frame.points import read_points
from calibration.frame.prompts import SIX_WAYS, Move
from calibration.frame.reasons import Reason, RefusedError
from calibration.frame.recorded import strokes_of_log, was_simulated
from calibration.frame.result import Outcome
from calibration.frame.sources import HandSource, LiveSetup, Setup, SimulatedSetup
from calibration.frame.stroke import AXES, Stroke
from calibration.frame.touches import TouchFit, fit_touches
from calibration.store import CalibrationSet
from tams_app.clock import MonotonicClock
from tams_app.config import Config, load_config
from tams_app.errors import ConfigError
from tams_app.records import Vector

MOST_ROUNDS = 4
_BEGINNINGS = 3  # of all the strokes, when they make no frame together
_INTRODUCTION = """\
How does the controller's tracking frame stand to the robot? You will press each button once, then
move the controller along the robot's axes, at least 200 mm each time, along something straight
where you can: x points away from the robot's base, y to the robot's left, z up. The arm is not
connected and does not move. Ctrl-C ends this at any time, and nothing is written."""


@dataclass(frozen=True, slots=True)
class Options:
    """What the command line asked for."""

    sim: bool = False
    logs: tuple[Path, ...] = ()
    touch: Path | None = None
    keep_scale: bool = False
    buttons: bool = True
    rounds: int = 2
    seed: int = 0
    picture: Path | None = None
    yes: bool = False


def run_frame(desk: Desk, config_path: Path | None, options: Options) -> int:
    """Calibrate; 0 if a file was written, 1 if not. TamsError says what to do instead."""
    if options.logs and (options.sim or options.touch):
        raise ConfigError("--from goes neither with --sim nor with --touch")
    config = load_config(config_path, {"rig.enabled": True} if options.sim else None)
    store = CalibrationSet.of(config_path, config)
    points = read_points(options.touch) if options.touch else []
    with desk:
        if options.logs:
            outcome = Outcome(_fit_logs(config, options.logs), None, None, None)
            hand = result.hand_with(config.hand, outcome.frame, options.keep_scale)
            source = "strokes recorded in " + ", ".join(str(log) for log in options.logs)
            _tell(desk, config, outcome.frame)
            desk.say("A recording cannot be tried out: watch the directions in `run --dry-run`.")
        else:
            setup = _setup(desk, config, options)
            source = f"{'touches' if points else 'strokes'} by {setup.description}"
            outcome = _measure(desk, setup, config, points, options)
            hand = result.hand_with(config.hand, outcome.frame, options.keep_scale)
        if options.picture is not None:
            save_picture(outcome.frame, options.picture)
        doubt = result.doubt(outcome.frame)
        if doubt and not _is_kept(desk, doubt):
            desk.say("Nothing is written.")
            return 1
        before = store.in_force(result.KIND)
        simulated = options.sim or any(was_simulated(log) for log in options.logs)
        found = result.calibration(config, outcome, hand, before, source, simulated)
        return 0 if store.propose(desk, found, options.yes) else 1


def _setup(desk: Desk, config: Config, options: Options) -> Setup:
    if options.sim:
        return SimulatedSetup(config, options.seed)
    if config.rig.enabled:
        raise ConfigError(
            "this configuration has the simulated rig: add --sim, or give --config with hardware"
        )
    return LiveSetup(config, MonotonicClock(), lambda _level, text: desk.say(text))


def _measure(
    desk: Desk, setup: Setup, config: Config, points: Sequence[Vector], options: Options
) -> Outcome:
    desk.say(_INTRODUCTION)
    buttons = _buttons(desk, setup, config) if options.buttons else None
    config = result.mapped(config, buttons)
    with setup.hand(config.controller) as source:
        frame: FrameFit | TouchFit
        if points:
            frame = fit_touches(ask_touches(desk, source, config, points))
        else:
            frame = fit_moves(desk, source, config, options.rounds)
        _tell(desk, config, frame)
        result.doubt(frame)  # what is no use needs no trying
        lit = _try(desk, source, config, frame, options)
    return Outcome(frame, buttons, lit, setup.true_rotation)


def _buttons(desk: Desk, setup: Setup, config: Config) -> ButtonFinding:
    with setup.buttons() as source:
        finding = ask_buttons(desk, source, config)
    desk.say(shown.as_text(shown.finding_table(finding)))
    return finding


def fit_moves(desk: Desk, source: HandSource, config: Config, rounds: int) -> FrameFit:
    """Rounds of three strokes, more while that helps; all anew when they make no frame."""
    for beginning in range(_BEGINNINGS):
        try:
            return _fit_rounds(desk, source, config, rounds)
        except RefusedError as error:
            if beginning == _BEGINNINGS - 1:
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


def _fit_logs(config: Config, logs: Sequence[Path]) -> FrameFit:
    strokes = [stroke for log in logs for stroke in strokes_of_log(log, config)]
    return fit_strokes(strokes, np.array(config.hand.rotation))


def _tell(desk: Desk, config: Config, frame: FrameFit | TouchFit) -> None:
    desk.say(shown.as_text(shown.result_table(frame)))
    for remark in result.remarks(config, frame):
        desk.say(remark)


def _try(
    desk: Desk, source: HandSource, config: Config, frame: FrameFit | TouchFit, options: Options
) -> Mapping[Move, bool]:
    """Refused unless each direction that was tried lit up."""
    desk.say(
        "Now try it: no arm is connected, the table shows where it would go. "
        "Enter skips a direction."
    )
    hand = result.hand_with(config.hand, frame, options.keep_scale)
    lit = try_six_ways(desk, source, config, hand)
    right = sum(lit.values())
    desk.say(f"{right} of {len(SIX_WAYS)} directions lit up as asked for.")
    if not all(lit.values()):
        wrong = ", ".join(way.name for way, is_right in lit.items() if not is_right)
        raise RefusedError(
            Reason.WRONG_WAY,
            f"Another direction lit up for {wrong}: if you moved as asked, calibrate again.",
        )
    return lit


def _is_kept(desk: Desk, doubt: str) -> bool:
    """Only a person can accept a doubtful result; --yes does not."""
    desk.say(doubt)
    if not desk.attended:
        raise RefusedError(
            Reason.UNCERTAIN,
            "A person at the terminal must confirm so uncertain a frame: run this from one, or "
            "make better strokes.",
        )
    return desk.conversation.yes("Keep it all the same?")
