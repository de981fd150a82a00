"""`run_tams.py doctor --speed`: which frame rate this machine holds, by running short sessions."""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np

from tams_app.config import Config
from tams_app.console.app import show_session
from tams_app.errors import SignalledError, TamsError
from tams_app.faces.display import has_display
from tams_app.faces.registry import check_faces
from tams_app.printing import Console
from tams_app.recording import LOG_NAME, SessionLog, read_log
from tams_app.records import LATE_NS
from tams_app.robot.build import check_names, check_ready_pose
from tams_app.robot.frame_rates import PERIOD_NS
from tams_app.robot.rate_ladder import STARTING, Observation
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.machine_speed import rungs, this_machine
from tams_app.session.folder import create_session_folder
from tams_app.session.run import run
from tams_app.units import NS_PER_MS, NS_PER_S

SESSION_S = 12.0
WARM_UP_NS = (STARTING + 1) * PERIOD_NS  # as long as the ladder of a session judges nothing
SHORTEST_NS = 2 * NS_PER_S  # for a judgement


@dataclass(frozen=True, slots=True)
class Stretch:
    """The figures of a time at one rate."""

    fps: float
    given_fps: float  # of the view with fewest
    late: float  # of the control ticks
    interval_p95_ms: float

    @property
    def held(self) -> bool:
        """True if the ladder of a session would stay at this rate."""
        return not Observation(1.0 - self.given_fps / self.fps, self.late).trouble

    def tree(self) -> dict[str, float | bool | None]:
        """As JSON has it, which has no infinite numbers."""
        interval_ms = self.interval_p95_ms
        finite_ms = interval_ms if math.isfinite(interval_ms) else None
        return {**asdict(self), "interval_p95_ms": finite_ms, "held": self.held}

    def __str__(self) -> str:
        return (
            f"{self.fps:g} frames a second (given {self.given_fps:.1f}, "
            f"p95 {self.interval_p95_ms:.0f} ms apart), control late {100 * self.late:.2f} %"
        )


def run_speed(
    config: Config,
    as_json: bool = False,
    console: Console | None = None,
    config_path: Path | None = None,
) -> int:
    """Measure without windows, and with them where there is a display; 1 if nothing is held.

    The last line is the command to use, with `config_path`, the file of `config`. `as_json`: print
    one object, the sentences on standard error. SignalledError if a signal ends it.
    """
    results = console or Console()
    console = Console(stderr=True) if as_json else results
    check_names(config)
    check_faces(config)
    check_ready_pose(config)
    machine, views = this_machine(), len(config.video.views)
    asked_fps = config.video.fps
    start_fps = machine.starting_fps(asked_fps)
    console.print(
        f"Quick probe: {machine.cores:g} cores of {machine.speed:.2f} times the reference; "
        f"a session begins with {start_fps:g} of {asked_fps} frames a second",
        highlight=False,
        soft_wrap=True,
    )
    held: Stretch | None = None
    holds, sessions = True, list[dict[str, object]]()
    for title, headless in (("Without windows", True), ("With windows", False)):
        if not headless and not has_display():
            console.print(f"{title}: not measured, there is no display.", highlight=False)
            continue
        found = list[Stretch]()
        for one in _walk(config, headless, start_fps):
            found.append(one)
            verdict = "held" if one.held else "not held"
            console.print(f"{title}: {one}: {verdict}", highlight=False, soft_wrap=True)
        held = max((one for one in found if one.held), key=lambda one: one.fps, default=None)
        holds = holds and held is not None
        sessions.append(
            {
                "windows": not headless,
                "held_fps": held and held.fps,
                "rates": [one.tree() for one in found],
            }
        )
        rate = "no rate of the ladder" if held is None else f"{held.fps:g} frames a second"
        console.print(f"{title}: this machine holds {views} views at {rate}.", highlight=False)
    console.print(
        _advice(config_path, held, asked_fps), highlight=False, soft_wrap=True, no_wrap=True
    )
    if as_json:
        probe = {**asdict(machine), "starting_fps": start_fps}
        tree = {"probe": probe, "asked_fps": asked_fps, "views": views, "sessions": sessions}
        results.out(json.dumps(tree), highlight=False)
    return 0 if holds else 1


def _walk(config: Config, headless: bool, start_fps: float) -> Iterator[Stretch]:
    """A session at each rate of the ladder: down from `start_fps` to one that is held, else up."""
    ladder = [int(fps) for fps in rungs(config.video.fps)]  # as `--fps` takes them
    start = next(rung for rung, fps in enumerate(ladder) if fps <= start_fps)
    for rung in range(start, len(ladder)):
        tried = stretch(_session(config, headless, ladder[rung]), ladder[rung])
        yield tried
        if tried.held:
            break
    if rung == start:
        for rung in reversed(range(start)):
            tried = stretch(_session(config, headless, ladder[rung]), ladder[rung])
            yield tried
            if not tried.held:
                return


def _advice(config_path: Path | None, held: Stretch | None, asked_fps: float) -> str:
    """The command to use."""
    file = f" --config {shlex.quote(str(config_path))}" if config_path else ""
    if held is None:
        return f"Close other programs, and see what is missing: run_tams.py doctor{file}"
    window = "" if has_display() else " --headless"
    fps = "" if held.fps == asked_fps else f" --fps {held.fps:g}"
    return f"Use: run_tams.py run{file}{' --sim' if file else ''}{window}{fps}"


def stretch(log: SessionLog, fps: float) -> Stretch:
    """The time of a session at `fps`, without its start, in which much is done that is done once.

    Where it ended before that nothing was held.
    """
    begin_ns = log.rates[0].t_ns + WARM_UP_NS if log.rates else log.ended_ns
    if log.ended_ns - begin_ns < SHORTEST_NS:
        return Stretch(fps, 0.0, 1.0, math.inf)
    return _stretch(log, fps, begin_ns, log.ended_ns)


def _stretch(log: SessionLog, fps: float, begin_ns: int, end_ns: int) -> Stretch:
    passed_s = (end_ns - begin_ns) / NS_PER_S
    times = {
        view: [
            one.capture_ns
            for one in log.captured
            if one.view == view and begin_ns <= one.capture_ns < end_ns
        ]
        for view in log.header.views
    }
    intervals = np.concatenate([np.diff(of_view) for of_view in times.values()])
    ticks = [one for one in log.ticks if begin_ns <= one.due_ns < end_ns]
    skipped = ticks[-1].skipped - ticks[0].skipped if ticks else 0
    late = sum(one.started_ns - one.due_ns > LATE_NS for one in ticks) + skipped
    return Stretch(
        fps,
        min(len(of_view) for of_view in times.values()) / passed_s,
        late / (len(ticks) + skipped) if ticks else 1.0,
        float(np.percentile(intervals, 95)) / NS_PER_MS if len(intervals) else float("inf"),
    )


def _session(config: Config, headless: bool, fps: int) -> SessionLog:
    """The log of a session of a few seconds at `fps`, in which the operator moves the arm."""
    with TemporaryDirectory(prefix="tams-speed-") as directory:
        recording = config.recording.model_copy(update={"directory": directory})
        config = config.model_copy(
            update={
                "recording": recording,
                "headless": headless,
                "seconds": None,
                "video": config.video.model_copy(update={"fps": fps}),
                "rig": config.rig.model_copy(update={"fixed_fps": True}),
            }
        )
        folder = create_session_folder(config)
        session = run(config, MonotonicClock(), folder, arm_at_once=True)
        signals: list[str] = []
        quiet = Console(quiet=True)
        show_session(session, quiet, interrupted=signals.append, limit_s=SESSION_S)
        if session.failure:
            raise TamsError(session.failure)
        if signals:
            raise SignalledError(f"{signals[0]}; nothing was measured")
        return read_log(folder / LOG_NAME)
