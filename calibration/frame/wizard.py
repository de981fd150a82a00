"""`run_tams.py calibrate frame`: buttons, strokes or touches, the fit, a try, and the question."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from calibration.desk import Desk
from calibration.frame import result, shown
from calibration.frame.asking import ask_buttons, try_six_ways
from calibration.frame.buttons import ButtonFinding
from calibration.frame.fit import FrameFit, fit_strokes
from calibration.frame.picture import save_picture
from calibration.frame.points import read_points
from calibration.frame.prompts import SIX_WAYS, Move
from calibration.frame.reasons import Reason, RefusedError
from calibration.frame.recorded import strokes_of_log, was_simulated
from calibration.frame.result import Outcome
from calibration.frame.rounds import fit_moves, fit_touched
from calibration.frame.sources import HandSource, LiveSetup, Setup, SimulatedSetup
from calibration.frame.touches import TouchFit, check_points
from calibration.store import CalibrationSet
from tams_app.config import Config, load_config
from tams_app.errors import ConfigError
from tams_app.records import Vector
from tams_app.runtime.clock import MonotonicClock

_INTRODUCTION = """\
How does the controller's tracking frame stand to the robot? The robot's x points away from its
base, y to its left, z up. Take the {hand} controller.
{tasks}
At last you try all six directions. The arm is not connected and does not move.
Ctrl-C ends this at any time, and nothing is changed."""
_BUTTONS = "You will press each button once.\n"
_STROKES = """\
You will move it along the robot's axes, at least 200 mm each time, along something straight where
you can."""
_TOUCHES = """\
You will touch the points of your list with the same part of the controller, always held the same
way."""
_SIMULATED = "A simulated person does all this now."


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
    """Calibrate; 0 if it was written or a person did not want it, else 1; or TamsError."""
    _check(options)
    config = load_config(config_path, {"rig.enabled": True} if options.sim else None)
    store = CalibrationSet.of(config_path, config)
    points = _points(options.touch) if options.touch else []
    simulated = options.sim or any(was_simulated(log) for log in options.logs)
    store.check_before(desk, options.yes, simulated)
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
        somebody_decides = desk.attended
        if doubt and not _is_kept(desk, doubt):
            desk.say("Nothing is written.")
            return 0
        before = store.in_force(result.KIND)
        found = result.calibration(config, outcome, hand, before, source, simulated)
        return 0 if store.propose(desk, found, options.yes) or somebody_decides else 1


def _check(options: Options) -> None:
    """ConfigError for what makes no sense, or could only fail once everything is measured."""
    if options.logs and (options.sim or options.touch):
        raise ConfigError("--from goes neither with --sim nor with --touch")
    if options.keep_scale and not options.touch:
        raise ConfigError("--keep-scale goes with --touch: strokes do not measure the scale")
    if options.picture is not None and options.picture.suffix.lower() != ".png":
        raise ConfigError(f"--picture {options.picture}: is drawn to .png")
    if options.picture is not None and not options.picture.parent.is_dir():
        raise ConfigError(f"--picture: there is no folder {options.picture.parent}")


def _points(path: Path) -> list[Vector]:
    points = read_points(path)
    try:
        check_points(points)
    except RefusedError as error:
        raise ConfigError(f"{path}: {error}") from error
    return points


def _setup(desk: Desk, config: Config, options: Options) -> Setup:
    if options.sim:
        return SimulatedSetup(config, options.seed)
    if config.rig.enabled:
        raise ConfigError(
            "this configuration has the simulated rig: add --sim, or give --config with hardware"
        )
    if not desk.attended:
        raise ConfigError(
            "nobody is at the terminal: start it from one, or give --sim or --from LOG"
        )
    return LiveSetup(config, MonotonicClock(), lambda _level, text: desk.say(text))


def _measure(
    desk: Desk, setup: Setup, config: Config, points: Sequence[Vector], options: Options
) -> Outcome:
    tasks = (_BUTTONS if options.buttons else "") + (_TOUCHES if points else _STROKES)
    desk.say(_INTRODUCTION.format(hand=config.controller.hand, tasks=tasks))
    if options.sim:
        desk.say(_SIMULATED)
    buttons = _buttons(desk, setup, config) if options.buttons else None
    config = result.mapped(config, buttons)
    with setup.hand(config.controller) as source:
        frame: FrameFit | TouchFit
        if points:
            frame = fit_touched(desk, source, config, points)
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
        "Now try it: no arm is connected, the table shows where it would go. Move some 200 mm each "
        "time; Enter skips a direction."
    )
    hand = result.hand_with(config.hand, frame, options.keep_scale)
    lit = try_six_ways(desk, source, config, hand)
    right = sum(lit.values())
    desk.say(f"{right} of {len(SIX_WAYS)} directions lit up as asked for.")
    if not all(lit.values()):
        wrong = ", ".join(way.name for way, is_right in lit.items() if not is_right)
        raise RefusedError(
            Reason.WRONG_WAY,
            f"Another direction lit up for {wrong}, or none: if you moved as asked, the frame is "
            "wrong; calibrate again.",
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
