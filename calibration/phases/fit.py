"""Trials as Algorithm 1 sees them, how often it is right, and thresholds fitted to their labels."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise, product
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from calibration.kit import Progress, quiet
from tams_app.config import PhasesConfig
from tams_app.errors import ConfigError, TamsError, UnreadableLogError
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
class Scores:
    """`confusion[i, j]`: counted ticks of true phase i that were inferred as j, in the order of
    `PHASES`."""

    confusion: Counts

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
    return Scores(confusion)


def evaluate(trials: Sequence[Trial], thresholds: PhasesConfig) -> Scores:
    """The scores of `thresholds` over `trials`."""
    return score(trials, [infer(trial.motion, thresholds) for trial in trials])


def stretches(values: Codes | NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Start and stop of each stretch of one value."""
    edges = (np.flatnonzero(np.diff(values)) + 1).tolist()
    return list(pairwise([0, *edges, len(values)]))


SEARCHED = ("v_eps_mm_s", "vz_min_mm_s", "align_dwell_s", "pre_release_dwell_s")
_STEPS = (0.25, 0.25, 0.025, 0.025)  # the search's resolution; of the dwells three control periods

# of `SEARCHED`, in `_STEPS`
Point: TypeAlias = tuple[int, int, int, int]

# With a dwell time of 0 every motion is ALIGN or PRE_RELEASE: that abolishes a phase.
SMALLEST: Point = (0, 0, 1, 1)
LARGEST: Point = (160, 240, 60, 60)  # 40 mm/s, 60 mm/s, 1.5 s
_V_EPS = (4, 12, 20, 32, 56, 80, 112)
_VZ_MIN = (8, 20, 40, 60, 88, 128)
_DWELLS = (1, 4, 8, 12, 18, 26, 36)
_LOCAL_SEARCHES = 3  # from the best points of the grid
_STRIDES = ((8, 8, 4), (4, 4, 2), (2, 2, 1), (1, 1, 1))  # of v_ε, v_z^min and the dwell times
_DWELL_WINDOW = (-1, 0, 1)  # strides; recovers what it is not given as surely as a wider one
_OPEN = np.array([CODE[phase] for phase in (Phase.REACH, Phase.ALIGN, Phase.RELEASE)], np.int8)


def thresholds_at(point: Point, smoothing_ms: float) -> PhasesConfig:
    """A point of the search in the configuration's units."""
    values = (round(steps * step, 6) for steps, step in zip(point, _STEPS, strict=True))
    named = dict(zip(SEARCHED, values, strict=True))
    return PhasesConfig.model_validate(named | {"smoothing_ms": smoothing_ms})


def point_of(thresholds: PhasesConfig) -> Point:
    """The point of the search nearest to `thresholds`."""
    steps = zip(SEARCHED, _STEPS, strict=True)
    v_eps, vz_min, align, pre = (round(getattr(thresholds, name) / step) for name, step in steps)
    return v_eps, vz_min, align, pre


DEFAULT_POINT = point_of(PhasesConfig())


# How good a point is: fewer misses first, then nearer to the defaults, then smaller numbers.
_Rank: TypeAlias = tuple[int, float, Point]


class Search:
    """Looks for the best thresholds over any choice of the trials; each run is made once.

    Algorithm 1 itself is run, never a copy of it. What makes that affordable: with the gripper open
    it knows T_align only and with it closed T_pre only, and a gripper edge decides by itself; so
    one run with both dwell times set to T gives the hits of the open stretches for T_align = T and
    of the closed ones for T_pre = T, and hits add up
    (`tests/calibration/test_phases_search.py` holds it).
    """

    def __init__(self, trials: Sequence[Trial]) -> None:
        self._trials = trials
        self._hits: dict[tuple[int, int, int, int], tuple[int, int]] = {}

    def hits(self, point: Point, chosen: Sequence[int]) -> int:
        """In how many ticks of the `chosen` trials (by index) Algorithm 1 says the true phase."""
        v_eps, vz_min, align, pre = point
        return sum(
            self._run(trial, v_eps, vz_min, align)[0] + self._run(trial, v_eps, vz_min, pre)[1]
            for trial in chosen
        )

    def best(self, chosen: Sequence[int], progress: Progress = quiet) -> Point:
        """The point with the most hits over `chosen`; of equals the nearest to the defaults.

        A coarse grid, then from its best points downhill with shrinking strides. Nothing of the
        trials that are not chosen is looked at. `progress` is of the grid.
        """
        starts = sorted(self._grid(chosen, progress))[:_LOCAL_SEARCHES]
        return min(self._descend(start, chosen) for start in starts)[2]

    def _grid(self, chosen: Sequence[int], progress: Progress) -> Iterator[_Rank]:
        """For each pair of speeds of the grid the best dwell times; the defaults besides."""
        yield self._rank(DEFAULT_POINT, chosen)
        pairs = list(product(_V_EPS, _VZ_MIN))
        for done, (v_eps, vz_min) in enumerate(pairs, start=1):
            yield self._with_best_dwells(v_eps, vz_min, _DWELLS, _DWELLS, chosen)
            progress("searching", done / len(pairs))

    def _descend(self, start: _Rank, chosen: Sequence[int]) -> _Rank:
        """From `start` to the best neighbour, and so on, until none is better at any stride."""
        best = start
        for stride in _STRIDES:
            while (nearby := self._best_near(best[2], stride, chosen)) < best:
                best = nearby
        return best

    def _best_near(
        self, point: Point, stride: tuple[int, int, int], chosen: Sequence[int]
    ) -> _Rank:
        """The best point within one stride."""
        v_eps, vz_min, align, pre = point
        aligns, pres = _window(align, stride[2]), _window(pre, stride[2])
        return min(
            self._with_best_dwells(v_eps + a, vz_min + b, aligns, pres, chosen)
            for a, b in product((-stride[0], 0, stride[0]), (-stride[1], 0, stride[1]))
            if SMALLEST[0] <= v_eps + a <= LARGEST[0] and SMALLEST[1] <= vz_min + b <= LARGEST[1]
        )

    def _with_best_dwells(
        self,
        v_eps: int,
        vz_min: int,
        aligns: Sequence[int],
        pres: Sequence[int],
        chosen: Sequence[int],
    ) -> _Rank:
        """The best T_align does not depend on T_pre, nor the other way round."""
        align = min(self._rank((v_eps, vz_min, align, pres[0]), chosen) for align in aligns)
        best = align[2][2]
        return min(self._rank((v_eps, vz_min, best, pre), chosen) for pre in pres)

    def _rank(self, point: Point, chosen: Sequence[int]) -> _Rank:
        apart = sum((a - b) ** 2 / b**2 for a, b in zip(point, DEFAULT_POINT, strict=True))
        return -self.hits(point, chosen), apart, point

    def _run(self, trial: int, v_eps: int, vz_min: int, dwell: int) -> tuple[int, int]:
        """Hits with the gripper open and with it closed, both dwell times being `dwell`."""
        key = (trial, v_eps, vz_min, dwell)
        if key not in self._hits:
            labelled = self._trials[trial]
            # the smoothing is in the speeds already
            inferred = infer(labelled.motion, thresholds_at((v_eps, vz_min, dwell, dwell), 100.0))
            right = inferred == labelled.labels
            is_open = np.isin(inferred, _OPEN)
            self._hits[key] = (
                int(np.count_nonzero(right & is_open)),
                int(np.count_nonzero(right & ~is_open)),
            )
        return self._hits[key]


def _window(dwell: int, stride: int) -> list[int]:
    """The dwell times around one, within the range."""
    around = (dwell + step * stride for step in _DWELL_WINDOW)
    return [value for value in around if SMALLEST[2] <= value <= LARGEST[2]]


LEAST_TRIALS = 3


@dataclass(frozen=True, slots=True)
class PhaseFit:
    """The thresholds found, and how well they do.

    `left_out`: each trial inferred with the thresholds of its own fold. `defaults`: with the
    study's, which are the paper's Algorithm 1 as configured.
    """

    thresholds: PhasesConfig
    in_sample: Scores
    left_out: Scores
    defaults: Scores
    folds: tuple[PhasesConfig, ...]  # of each trial left out: what the others give

    @property
    def at_the_edge(self) -> list[str]:
        """The parameters that ended at an end of what was searched."""
        ranges = zip(SEARCHED, point_of(self.thresholds), SMALLEST, LARGEST, strict=True)
        return [name for name, value, *ends in ranges if value in ends]


def fit_thresholds(
    trials: Sequence[Trial], smoothing_ms: float, progress: Progress = quiet
) -> PhaseFit:
    """Search over all trials, then once more without each of them.

    `smoothing_ms`: the time constant that made the trials' speeds. TamsError if the trials are too
    few or their labels cannot distinguish the phases.
    """
    check_trials(trials)
    search, everything = Search(trials), range(len(trials))
    best = search.best(everything, progress)
    folds = []
    for out in everything:
        others = [place for place in everything if place != out]
        folds.append(thresholds_at(search.best(others), smoothing_ms))
        progress("leaving out each trial in turn", (out + 1) / len(trials))
    chosen = thresholds_at(best, smoothing_ms)
    pairs = zip(trials, folds, strict=True)
    return PhaseFit(
        chosen,
        evaluate(trials, chosen),
        score(trials, [infer(trial.motion, thresholds) for trial, thresholds in pairs]),
        evaluate(trials, PhasesConfig()),
        tuple(folds),
    )


def check_trials(trials: Sequence[Trial]) -> None:
    """TamsError with the reason if nothing can be learned from these."""
    check_count(len(trials))
    for trial in trials:
        _check_labels(trial)
    seen = {int(code) for trial in trials for code in np.unique(trial.labels)}
    missing = [phase.value for code, phase in enumerate(PHASES) if code not in seen]
    if missing:
        raise TamsError(
            f"the phase {missing[0]} never occurs in the {len(trials)} trials: "
            "give trials in which the block is grasped, carried and released"
        )


def check_count(trials: int) -> None:
    """ConfigError if so many are too few."""
    if trials < LEAST_TRIALS:
        few = "1 trial is" if trials == 1 else f"{trials} trials are"
        raise ConfigError(
            f"{few} too few to leave one out and learn from the others: "
            f"give at least {LEAST_TRIALS}"
        )


def _check_labels(trial: Trial) -> None:
    counted = trial.labels[trial.labels != NOT_COUNTED]
    if len(np.unique(counted)) < 2:
        only = PHASES[counted[0]].value if len(counted) else "nothing"
        raise TamsError(f"{trial.name}: is labelled {only} throughout: leave it out or mark it")
    closes = any(closed for _, _, closed, _ in trial.motion.inputs)
    needs_closed = [phase for phase in PHASES[2:5] if PHASES.index(phase) in counted]
    if needs_closed and not closes:
        raise TamsError(
            f"{trial.name}: is labelled {needs_closed[0].value} but its gripper never closes: "
            "these labels are of another trial"
        )
