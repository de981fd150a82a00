"""The conversation: which camera is which, and how well each sees."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from calibration.cameras import image_step, intrinsics_step, latency_step
from calibration.cameras.asking import agreed
from calibration.cameras.bench import Bench
from calibration.cameras.board import Board, print_board
from calibration.cameras.findings import Findings
from calibration.cameras.from_log import findings_of_log
from calibration.cameras.keeping import keep
from calibration.cameras.picture import check_drawable, draw_findings
from calibration.cameras.screen import check_display
from calibration.cameras.steps import (
    CLOCKS,
    EXPOSURE,
    FOCUS,
    INTRINSICS,
    LATENCY,
    OFFERED,
    RATE,
    WHICH,
    chosen_steps,
)
from calibration.cameras.which_step import bind_views
from calibration.desk import Desk
from calibration.store import CalibrationSet
from tams_app.config import Config, load_config
from tams_app.errors import ConfigError, SetupError, TamsError
from tams_app.runtime.clock import Clock, MonotonicClock


@dataclass(frozen=True, slots=True)
class Options:
    """What the command line asks for."""

    sim: bool = False
    logs: tuple[Path, ...] = ()
    only: str = ""
    board: Path | None = None  # to print one and end
    square_mm: float = 28.0
    pattern_hz: int = 60
    picture: Path | None = None
    seed: int = 0
    yes: bool = False


MakeBench = Callable[[Config, Options, Clock, Board], Bench]


def run_cameras(
    desk: Desk, config_path: Path | None, options: Options, make_bench: MakeBench | None = None
) -> int:
    """Do the chosen steps, show what was found, write it if wanted; the exit code.

    `make_bench`: another source of cameras than the options name.
    """
    steps = chosen_steps(options.only)
    _check(options)
    board = Board(square_mm=options.square_mm)
    if options.board is not None:
        print_board(board, options.board)
        desk.say(f"Written: {options.board}. Print it at 100 % and measure its line of 100 mm.")
        return 0
    with desk:
        if options.logs:
            for folder in options.logs:
                _draw(desk, findings_of_log(desk, folder), options)
            return 0
        config = load_config(config_path)
        check_source(config, options)
        store = CalibrationSet.of(config_path, config)
        store.check_before(desk, options.yes, options.sim)
        clock = MonotonicClock()
        bench = (make_bench or _bench)(config, options, clock, board)
        try:
            if bench.attended and not desk.attended:
                raise ConfigError(
                    "nobody is at the terminal: start it from one, or give --sim or --from LOG"
                )
            if not bench.attended:
                desk.say("A simulated person does what is asked for here.")
            found = _bind(desk, bench, config, steps)
            try:
                _measure(desk, bench, config, clock, steps, options, board, found)
            except (KeyboardInterrupt, TamsError) as early:
                if not (bench.attended and desk.attended):
                    raise
                desk.say(f"\nEnded early: {str(early) or 'Ctrl-C'}\nWhat was found until then:")
                keep(desk, bench, config, store, found, board, yes=False)
                raise
            _draw(desk, found, options)
            return keep(desk, bench, config, store, found, board, options.yes)
        finally:
            bench.close()


def _check(options: Options) -> None:
    """ConfigError for what makes no sense, or could only fail once everything is measured."""
    if options.logs and options.sim:
        raise ConfigError("--from and --sim exclude each other: take one")
    if not math.isfinite(options.square_mm):
        raise ConfigError("--square-mm must be a length")
    if options.picture is None:
        return
    if len(options.logs) > 1:
        raise ConfigError("--picture is of one log: the next one's would be drawn over it")
    check_drawable(options.picture)


def check_source(config: Config, options: Options) -> None:
    """ConfigError if the configuration's own cameras are not those that would be looked at."""
    if config.rig.enabled and not options.sim:
        raise ConfigError(
            "this configuration uses the simulated rig, which brings its own cameras: give --sim, "
            "or --config with your laboratory's"
        )


def _bench(config: Config, options: Options, clock: Clock, board: Board) -> Bench:
    if options.sim:
        from calibration.cameras.simulated_bench import SimulatedBench  # only this needs MuJoCo

        return SimulatedBench(config, options.seed, clock, board)
    from calibration.cameras.live_bench import LiveBench

    if LATENCY in chosen_steps(options.only):
        check_display()
    return LiveBench(config.video, clock, options.pattern_hz)


def _bind(desk: Desk, bench: Bench, config: Config, steps: Sequence[str]) -> list[Findings]:
    views = config.video.views
    cameras = bind_views(desk, bench, views) if WHICH in steps else _bound(bench, config)
    return [Findings(view, cameras[view]) for view in views]


def _measure(
    desk: Desk,
    bench: Bench,
    config: Config,
    clock: Clock,
    steps: Sequence[str],
    options: Options,
    board: Board,
    found: list[Findings],
) -> None:
    looking = [step for step in (FOCUS, EXPOSURE, RATE) if step in steps]
    for each in found:
        if FOCUS in steps:
            image_step.focus(desk, bench, each)
        if looking:
            image_step.look(desk, bench, each, looking)
        if EXPOSURE in steps:
            image_step.offer_settings(desk, bench, each)

    def wanted(step: str) -> bool:
        offered = not options.only and agreed(desk, bench, OFFERED[step], otherwise=False)
        return step in steps or offered

    if wanted(LATENCY):
        try:
            latency_step.measure_latency(desk, bench, found, config, clock)
        except SetupError as error:
            if LATENCY in steps:
                raise
            desk.say(f"Left out: {error}.")
    if wanted(CLOCKS):
        latency_step.measure_offsets_by_light(desk, bench, found)
    if wanted(INTRINSICS):
        for each in found:
            intrinsics_step.measure_intrinsics(desk, bench, each, board)


def _bound(bench: Bench, config: Config) -> dict[str, str]:
    """The cameras that the configuration names; ConfigError if one is not there."""
    cameras = {}
    for view in config.video.views:
        camera = bench.camera_of(config.cameras[view]) if view in config.cameras else ""
        if not camera:
            raise ConfigError(
                f"no camera that is plugged in is cameras.{view}: add which to --only, so that it "
                "is found"
            )
        cameras[view] = camera
    return cameras


def _draw(desk: Desk, found: Sequence[Findings], options: Options) -> None:
    if options.picture is not None:
        draw_findings(found, options.picture)
        desk.say(f"Drawn: {options.picture}")
