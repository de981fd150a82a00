"""A trial as Algorithm 1 sees it, with its true phases; and Algorithm 1 over it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from tams_app.config import PhasesConfig
from tams_app.errors import UnreadableLogError
from tams_app.policy.phases import PhaseTracker, SmoothedSpeed
from tams_app.records import Phase, Tick
from tams_app.units import NS_PER_S

Codes: TypeAlias = NDArray[np.int8]
Floats: TypeAlias = NDArray[np.float64]

PHASES = tuple(Phase)
CODE = {phase: code for code, phase in enumerate(PHASES)}
NOT_COUNTED = -1  # a tick of no phase: before the start, or not known

# v̄ [m/s], v̄_z [m/s], gripper closed (None: unknown), Δt [s]
StepInput: TypeAlias = tuple[float, float, bool | None, float]


@dataclass(frozen=True, slots=True)
class TrialMotion:
    """What the control loop gave Algorithm 1, tick by tick, n ticks in all.

    `t_s` since the session started, shape (n,). `inputs`: one per tick.
    """

    name: str
    t_s: Floats
    inputs: tuple[StepInput, ...]

    @property
    def last_s(self) -> float:
        """When the last tick was."""
        return float(self.t_s[-1])


@dataclass(frozen=True, slots=True)
class Trial:
    """A motion and its true phases: codes of `PHASES` or NOT_COUNTED, shape (n,)."""

    motion: TrialMotion
    labels: Codes

    @property
    def name(self) -> str:
        return self.motion.name


def motion_of(
    name: str, ticks: Sequence[Tick], started_ns: int, smoothing_ms: float
) -> TrialMotion:
    """The inputs of Algorithm 1 anew from logged ticks, as `ControlLoop` makes them.

    LogError if there are no ticks, or none with an arm state.
    """
    if not any(tick.arm is not None for tick in ticks):
        raise UnreadableLogError(
            f"{name}: has no state of the arm in it: give a session in which the arm was connected"
        )
    smoothed = SmoothedSpeed(smoothing_ms / 1000)
    inputs: list[StepInput] = []
    last_ns = ticks[0].started_ns
    for tick in ticks:
        if tick.arm is not None:
            smoothed.update(tick.arm.tcp.position, tick.arm.received_ns)
        closed = tick.arm.gripper_closed if tick.arm is not None else None
        period_s = (tick.started_ns - last_ns) / NS_PER_S
        inputs.append((smoothed.speed, smoothed.vertical_speed, closed, period_s))
        last_ns = tick.started_ns
    t_s = np.array([(tick.started_ns - started_ns) / NS_PER_S for tick in ticks])
    return TrialMotion(name, t_s, tuple(inputs))


def infer(motion: TrialMotion, thresholds: PhasesConfig) -> Codes:
    """The phases that Algorithm 1 gives with `thresholds`, codes of `PHASES`, shape (n,)."""
    step = PhaseTracker(thresholds).step
    return np.fromiter(
        (
            CODE[step(speed=speed, vertical_speed=vertical, closed=closed, period_s=dt).phase]
            for speed, vertical, closed, dt in motion.inputs
        ),
        np.int8,
        len(motion.inputs),
    )


Counts: TypeAlias = NDArray[np.int64]


@dataclass(frozen=True, slots=True)
class Switches:
    """How a phase was entered, over all trials.

    `delays_s`: of each true switch that was found, from it to the inferred one; negative if that
    came first. `missed`: true switches to which no inferred one belongs. `spurious`: inferred
    switches into the phase that belong to no true one; one made where nothing counts is none.
    """

    delays_s: tuple[float, ...]
    missed: int
    spurious: int

    def percentile_s(self, percent: float) -> float | None:
        """Of the delays; None if there are none."""
        return float(np.percentile(self.delays_s, percent)) if self.delays_s else None


@dataclass(frozen=True, slots=True)
class Scores:
    """`confusion[i, j]`: counted ticks of true phase i that were inferred as j, in the order of
    `PHASES`."""

    confusion: Counts
    switches: dict[Phase, Switches]

    @property
    def ticks(self) -> int:
        """How many were counted."""
        return int(self.confusion.sum())

    @property
    def accuracy(self) -> float:
        """Share of the counted ticks whose phase is the true one."""
        return float(np.trace(self.confusion) / self.confusion.sum())

    @property
    def mean_recall(self) -> float:
        """Of the phases that occur: what accuracy would be if all lasted equally long."""
        recalls = [self.recall(phase) for phase in PHASES]
        return float(np.mean([recall for recall in recalls if recall is not None]))

    def recall(self, phase: Phase) -> float | None:
        """Share of the true phase's ticks that were inferred as it; None if it never was."""
        row = self.confusion[CODE[phase]]
        return float(row[CODE[phase]] / row.sum()) if row.sum() else None


def score(trials: Sequence[Trial], inferred: Sequence[Codes]) -> Scores:
    """Scores of all trials together; ticks that are not counted count nowhere."""
    confusion = np.zeros((len(PHASES), len(PHASES)), np.int64)
    for trial, codes in zip(trials, inferred, strict=True):
        counted = trial.labels != NOT_COUNTED
        np.add.at(confusion, (trial.labels[counted], codes[counted]), 1)
    switches = {
        phase: _together(
            [
                switches_into(CODE[phase], trial.motion.t_s, trial.labels, codes)
                for trial, codes in zip(trials, inferred, strict=True)
            ]
        )
        for phase in PHASES
    }
    return Scores(confusion, switches)


def switches_into(code: int, t_s: Floats, labels: Codes, inferred: Codes) -> Switches:
    """How one phase was entered in one trial.

    To a true stretch of the phase belongs the first inferred stretch that overlaps it and belongs
    to no earlier one; the delay is from begin to begin. What begins where nothing was counted
    before is no switch.
    """
    true_runs, inferred_runs = (
        [run for run in stretches(codes) if codes[run[0]] == code] for codes in (labels, inferred)
    )
    taken: set[tuple[int, int]] = set()
    delays: list[float] = []
    missed = 0
    for start, stop in true_runs:
        free = (run for run in inferred_runs if run not in taken)
        found = next((run for run in free if run[0] < stop and run[1] > start), None)
        if found is not None:
            taken.add(found)
        if start == 0 or labels[start - 1] == NOT_COUNTED:
            continue
        if found is None:
            missed += 1
        else:
            delays.append(float(t_s[found[0]] - t_s[start]))
    others = [start for start, stop in inferred_runs if (start, stop) not in taken]
    spurious = [start for start in others if start > 0 and labels[start] != NOT_COUNTED]
    return Switches(tuple(delays), missed, len(spurious))


def stretches(values: Codes | NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Start and stop of each stretch of one value."""
    edges = (np.flatnonzero(np.diff(values)) + 1).tolist()
    return list(pairwise([0, *edges, len(values)]))


def _together(parts: Sequence[Switches]) -> Switches:
    return Switches(
        tuple(delay for part in parts for delay in part.delays_s),
        sum(part.missed for part in parts),
        sum(part.spurious for part in parts),
    )
