"""How far apart two arms went that were moved by one recorded hand."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.experiments.replay import Replay
from tams_app.records import Vector
from tams_app.units import NS_PER_MS, NS_PER_S

_GRID_NS = 10 * NS_PER_MS


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
