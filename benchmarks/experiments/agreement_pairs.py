"""One recorded hand replayed live and in virtual time, and what both runs measured."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.experiments.agreement_measures import (
    KINDS,
    PRIMARY,
    Measures,
    matched_ssim,
    primary_measures,
    view_measures,
)
from benchmarks.experiments.recorded_motion import LIVE, HandSpan, record_hand
from benchmarks.experiments.replay import Replay, first_frames, read_replays
from benchmarks.experiments.virtual_runs import VirtualRuns, read_summary
from benchmarks.runs import Run, run_session
from tams_app.config import Config, dump_config, load_config
from tams_app.errors import TamsError
from tams_app.presses import ENGAGE_ABOVE
from tams_app.recording import LOG_NAME
from tams_app.records import Vector
from tams_app.study.trial_process import TrialProcess
from tams_app.units import NS_PER_MS, NS_PER_S

MISSED = "frames_missed_by_renderer_share"
AT_MOST_MISSED, AT_MOST_LATE = 0.01, 0.005  # `make bench` promises the ticks; a frame or two
_GRID_NS = 10 * NS_PER_MS  # of the hand's time, on which two ways are compared
_START_UP_S = 30.0  # a live session may take so long before its first tick, and the verdict after


@dataclass(frozen=True, slots=True)
class Pair:
    """One seed: what the live run and the virtual one measured, by view."""

    seed: int
    live: dict[str, Measures]
    virtual: dict[str, Measures]
    facts: dict[str, Any]

    @property
    def kept_up(self) -> bool:
        """Whether the machine was fast enough live; if not, what differs is the machine."""
        missed = [
            measures[MISSED] or 0.0 for view, measures in self.live.items() if view != PRIMARY
        ]
        late = self.facts["late_ticks_share"]
        return max(missed) <= AT_MOST_MISSED and late is not None and late <= AT_MOST_LATE


def measure_seed(folder: Path, given: Mapping[str, Any]) -> Pair:
    """Record a hand on the scene of a configuration, replay it live and in virtual time; TamsError.

    `given`: what the configuration is besides the default one, `seed` among it.
    """
    hand = folder / "hand.mcap"
    config = load_config(None, given)
    record_hand(config, hand, LIVE)
    span = HandSpan.of(hand, ENGAGE_ABOVE)
    config = load_config(
        None,
        {
            **given,
            "policy.budget.mode": "oracle",
            "video.repair.mode": "paper",
            "rig.hand_trajectory": str(hand),
            "seconds": span.end_ns / NS_PER_S + _START_UP_S,
        },
    )
    live = _run_live(config, folder)
    _run_virtual(config, folder)
    paths = [next((folder / "live").glob(f"*/{LOG_NAME}")), folder / "virtual" / LOG_NAME]
    replays = read_replays(paths, span.squeeze_ns, span.end_ns)
    return _pair(config.seed, replays[0], replays[1], live, read_summary(folder / "virtual"))


def _run_live(config: Config, folder: Path) -> Run:
    """A session started as a user starts it, with every key of `config`."""
    (folder / "live").mkdir()
    path = folder / "replay.yaml"
    path.write_text(dump_config(config), encoding="utf-8")
    return run_session(folder / "live", "--config", str(path))


def _run_virtual(config: Config, folder: Path) -> None:
    runs = VirtualRuns({"virtual": config})
    if failure := TrialProcess(runs, runs.job("virtual", folder)).wait():
        raise TamsError(f"the run of seed {config.seed} in virtual time failed: {failure}")


def _pair(seed: int, live: Replay, virtual: Replay, session: Run, summary: dict[str, Any]) -> Pair:
    views = live.log.header.views
    columns = [
        {**{view: view_measures(run, view) for view in views}, PRIMARY: primary_measures(run)}
        for run in (live, virtual)
    ]
    for view in (*views, PRIMARY):
        for kind in KINDS:
            found = np.array(matched_ssim(live, virtual, view, kind)).reshape(-1, 2)
            for column, values in zip(columns, found.T, strict=True):
                name = f"{kind}_ssim_at_equal_moments"
                column[view][name] = float(np.mean(values)) if len(values) else None
                column[view][f"{name}_n"] = float(len(values))
    first_live, first_virtual = first_frames(live), first_frames(virtual)
    facts = {
        "compared_s": round(live.span.seconds, 3),
        "outcome": {"live": session.summary["outcome"], "virtual": summary["outcome"]},
        "late_ticks_share": session.summary["control"]["late_fraction"],
        "load_percent": session.summary["system"]["cpu_percent"],
        "motion": asdict(motion_difference(live, virtual)),
        "first_frame": {
            view: {
                "index": [first_live[view][0], first_virtual[view][0]],
                "bytes": [len(first_live[view][1]), len(first_virtual[view][1])],
                "same": first_live[view] == first_virtual[view],
            }
            for view in views
        },
    }
    return Pair(seed, columns[0], columns[1], facts)


@dataclass(frozen=True, slots=True)
class MotionDifference:
    """TCP against TCP at the same moments of the hand, and the phases' beginnings."""

    rms_mm: float
    largest_mm: float
    same_phases: bool
    largest_phase_shift_s: float | None  # None where the phases are others
    live_phases: list[tuple[float, str]]  # seconds of the hand, phase
    virtual_phases: list[tuple[float, str]]


def motion_difference(live: Replay, virtual: Replay) -> MotionDifference:
    """Over the stretch that both have in common."""
    apart = 1000 * np.linalg.norm(_way(live) - _way(virtual), axis=1)
    phases = _phases(live), _phases(virtual)
    same = [name for _, name in phases[0]] == [name for _, name in phases[1]]
    shifts = [abs(one[0] - other[0]) for one, other in zip(*phases, strict=False)]
    return MotionDifference(
        rms_mm=float(np.sqrt(np.mean(apart**2))),
        largest_mm=float(np.max(apart)),
        same_phases=same,
        largest_phase_shift_s=max(shifts, default=0.0) if same else None,
        live_phases=phases[0],
        virtual_phases=phases[1],
    )


def _way(replay: Replay) -> Vector:
    """The TCP [m] on a grid of the hand's time, shape (n, 3)."""
    arms = {tick.arm.received_ns: tick.arm for tick in replay.log.ticks if tick.arm is not None}
    times_ns = np.array(sorted(arms), dtype=np.float64)
    places = np.array([arms[t_ns].tcp.position for t_ns in sorted(arms)])
    grid_ns = np.arange(replay.span.start_ns, replay.span.end_ns, _GRID_NS, dtype=np.float64)
    return np.stack([np.interp(grid_ns, times_ns, places[:, axis]) for axis in range(3)], axis=1)


def _phases(replay: Replay) -> list[tuple[float, str]]:
    return [
        (round((change.t_ns - replay.hand_began_ns) / NS_PER_S, 3), change.phase.value)
        for change in replay.log.phases
        if replay.inside(change.t_ns)
    ]
