"""The conversation: which camera is which, and how well each sees."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from calibration.cameras import intrinsics_step, latency_step, picture_step
from calibration.cameras.asking import agreed
from calibration.cameras.bench import Bench
from calibration.cameras.board import Board, print_board
from calibration.cameras.findings import Findings
from calibration.cameras.from_log import findings_of_log
from calibration.cameras.picture import draw_findings
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
from calibration.store import Calibration, CalibrationSet
from tams_app.clock import Clock, MonotonicClock
from tams_app.config import Config, load_config
from tams_app.errors import ConfigError, SetupError


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
    board = Board(square_mm=options.square_mm)
    steps = chosen_steps(options.only)
    if options.board is not None:
        print_board(board, options.board)
        desk.say(f"Written: {options.board}. Print it at 100 % and measure its line of 100 mm.")
        return 0
    if options.logs and options.sim:
        raise ConfigError("--from and --sim exclude each other: take one")
    with desk:
        if options.logs:
            for folder in options.logs:
                _draw(desk, findings_of_log(desk, folder), options)
            return 0
        config = load_config(config_path)
        check_source(config, options)
        clock = MonotonicClock()
        bench = (make_bench or _bench)(config, options, clock, board)
        try:
            if bench.attended and not desk.attended:
                raise ConfigError(
                    "nobody is at the terminal: start it from one, or give --sim or --from LOG"
                )
            found = _measure(desk, bench, config, clock, steps, options, board)
            _draw(desk, found, options)
            if options.sim and not config.rig.enabled:
                desk.say("Nothing is written: the rig's cameras are not this laboratory's.")
                return 0
            return _keep(desk, bench, config, config_path, found, options, board)
        finally:
            bench.close()


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

    return LiveBench(config.video, clock, options.pattern_hz)


def _measure(
    desk: Desk,
    bench: Bench,
    config: Config,
    clock: Clock,
    steps: Sequence[str],
    options: Options,
    board: Board,
) -> list[Findings]:
    views = config.video.views
    cameras = bind_views(desk, bench, views) if WHICH in steps else _bound(bench, config)
    found = [Findings(view, cameras[view]) for view in views]
    looking = [step for step in (FOCUS, EXPOSURE, RATE) if step in steps]
    for each in found:
        if FOCUS in steps:
            picture_step.focus(desk, bench, each)
        if looking:
            picture_step.look(desk, bench, each, looking)
        if EXPOSURE in steps:
            picture_step.offer_settings(desk, bench, each)

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
    return found


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


def _keep(
    desk: Desk,
    bench: Bench,
    config: Config,
    config_path: Path | None,
    found: Sequence[Findings],
    options: Options,
    board: Board,
) -> int:
    """Propose the calibration, and the lenses beside it."""
    made = datetime.now(UTC).strftime("%Y%m%dT%H%M%SZ")
    for each in found:
        if each.intrinsics is not None:
            each.intrinsics_file = intrinsics_step.file_name(each, made)
    changes = {"cameras": {each.view: camera_keys(bench, config, each) for each in found}}
    quality: dict[str, Any] = {each.view: each.quality() for each in found}
    calibration = Calibration("cameras", changes, bench.source, quality, options.sim)
    store = CalibrationSet.of(config_path, config)
    written = store.propose(desk, calibration, options.yes)
    if written is None:
        return 0 if desk.attended else 1
    for each in found:
        if each.intrinsics is not None:
            intrinsics_step.write_intrinsics(each, board, store.folder, made)
    return 0


def camera_keys(bench: Bench, config: Config, found: Findings) -> dict[str, Any]:
    """All keys of a view's camera that this kind of calibration knows.

    All of them each time: the new file replaces the old one. What was not measured now stays as
    the configuration has it.
    """
    before = config.cameras.get(found.view)
    keys: dict[str, Any] = dict(bench.binding(found.camera))
    if found.settings is not None:
        keys["exposure_us"] = found.settings.exposure_us
        keys["white_balance_k"] = found.settings.white_balance_k
    elif before is not None:
        keys["exposure_us"] = before.exposure_us
        keys["white_balance_k"] = before.white_balance_k
    return keys
