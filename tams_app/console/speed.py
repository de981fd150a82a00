"""`run_tams.py doctor --speed`: which frame rate this machine holds, by running short sessions."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
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
from tams_app.runtime.clock import MonotonicClock
from tams_app.runtime.machine_speed import this_machine
from tams_app.session.folder import create_session_folder
from tams_app.session.run import run
from tams_app.summary.frame_rate import ENOUGH
from tams_app.units import NS_PER_MS, NS_PER_S

SESSION_S = 10.0
SETTLING_NS = NS_PER_S
SHORTEST_NS = 2 * NS_PER_S  # at one rate, for a judgement of it
MOST_LATE = 0.005  # of the control ticks


@dataclass(frozen=True, slots=True)
class Stretch:
    """A time at one rate."""

    fps: float
    given_fps: float  # of the view with fewest
    late: float  # of the control ticks
    interval_p95_ms: float

    @property
    def held(self) -> bool:
        """True if frames and control loop kept their times."""
        return self.late <= MOST_LATE and self.given_fps >= ENOUGH * self.fps

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


def run_speed(config: Config, as_json: bool = False, console: Console | None = None) -> int:
    """Measure without windows, and with them where there is a display; 1 if nothing is held.

    `as_json`: print one object, the sentences on standard error. SignalledError if a signal ends
    it.
    """
    results = console or Console()
    console = Console(stderr=True) if as_json else results
    check_names(config)
    check_faces(config)
    check_ready_pose(config)
    machine, views = this_machine(), len(config.video.views)
    asked_fps = config.video.fps
    console.print(
        f"Quick probe: {machine.cores:g} cores of {machine.speed:.2f} times the reference; "
        f"a session begins with {machine.starting_fps(asked_fps):g} of {asked_fps} frames a second",
        highlight=False,
        soft_wrap=True,
    )
    holds, sessions = True, list[dict[str, object]]()
    for title, headless in (("Without windows", True), ("With windows", False)):
        if not headless and not has_display():
            console.print(f"{title}: not measured, there is no display.", highlight=False)
            continue
        console.print(f"{title}: a session of {SESSION_S:g} s ...", highlight=False)
        found = list(stretches(_session(config, headless)))
        held = max((one for one in found if one.held), key=lambda one: one.fps, default=None)
        holds = holds and held is not None
        sessions.append(
            {
                "windows": not headless,
                "held_fps": held and held.fps,
                "rates": [one.tree() for one in found],
            }
        )
        if held is not None:
            verdict = f"this machine holds {views} views × {held}."
        else:
            tried = "; ".join(map(str, found)) or "too few frames to tell"
            verdict = (
                f"this machine holds {views} views at no rate that was tried: {tried}. "
                "Close other programs; `doctor` says whether real-time priority is missing."
            )
        console.print(f"{title}: {verdict}", highlight=False, soft_wrap=True)
    if as_json:
        probe = {**asdict(machine), "starting_fps": machine.starting_fps(asked_fps)}
        tree = {"probe": probe, "asked_fps": asked_fps, "views": views, "sessions": sessions}
        results.out(json.dumps(tree), highlight=False)
    return 0 if holds else 1


def stretches(log: SessionLog) -> Iterator[Stretch]:
    """The times of a session at one rate that were long enough, without their first second."""
    changes = [one for one in log.rates if one.reason or one is log.rates[0]]
    ends_ns = [one.t_ns for one in changes[1:]] + [log.ended_ns]
    for change, end_ns in zip(changes, ends_ns, strict=True):
        begin_ns = change.t_ns + SETTLING_NS
        if end_ns - begin_ns >= SHORTEST_NS:
            yield _stretch(log, change.asked_fps, begin_ns, end_ns)


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


def _session(config: Config, headless: bool) -> SessionLog:
    """The log of a session of a few seconds, in which the operator moves the arm."""
    with TemporaryDirectory(prefix="tams-speed-") as directory:
        recording = config.recording.model_copy(update={"directory": directory})
        config = config.model_copy(
            update={"recording": recording, "headless": headless, "seconds": None}
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
