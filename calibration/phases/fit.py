"""Thresholds from labelled trials, with the accuracy that each trial has without having a say."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import TypeAlias

import numpy as np

from calibration.phases.search import (
    DWELL_STEP_S,
    LARGEST,
    SMALLEST,
    SPEED_STEP_MM_S,
    Search,
    point_of,
    thresholds_at,
)
from calibration.phases.trials import NOT_COUNTED, PHASES, Floats, Scores, Trial, infer, score
from tams_app.config import PhasesConfig
from tams_app.errors import ConfigError, TamsError

LEAST_TRIALS = 3
SEARCHED = ("v_eps_mm_s", "vz_min_mm_s", "align_dwell_s", "pre_release_dwell_s")
Progress: TypeAlias = Callable[[str, float], None]  # what is under way, and the part of it done


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
    trials: Sequence[Trial], smoothing_ms: float, progress: Progress = lambda *_: None
) -> PhaseFit:
    """Search over all trials, then once more without each of them.

    `smoothing_ms`: the time constant that made the trials' speeds. TamsError if the trials are too
    few or their labels cannot tell the phases apart.
    """
    check_trials(trials)
    search = Search(trials)
    everything = range(len(trials))
    best = search.best(everything, lambda part: progress("searching", part))
    folds, inferred = [], []
    for out, trial in enumerate(trials):
        others = [place for place in everything if place != out]
        thresholds = thresholds_at(search.best(others, lambda _: None), smoothing_ms)
        inferred.append(infer(trial.motion, thresholds))
        folds.append(thresholds)
        progress("leaving out each trial in turn", (out + 1) / len(trials))
    chosen = thresholds_at(best, smoothing_ms)
    return PhaseFit(
        chosen,
        evaluate(trials, chosen),
        score(trials, inferred),
        evaluate(trials, PhasesConfig()),
        tuple(folds),
    )


def evaluate(trials: Sequence[Trial], thresholds: PhasesConfig) -> Scores:
    """The scores of `thresholds` over `trials`."""
    return score(trials, [infer(trial.motion, thresholds) for trial in trials])


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


@dataclass(frozen=True, slots=True)
class Sensitivity:
    """Accuracy over all trials against one parameter, the others as chosen; shapes (n,)."""

    parameter: str
    values: Floats
    accuracy: Floats
    chosen: float
    default: float


def sensitivity(
    trials: Sequence[Trial], chosen: PhasesConfig, progress: Progress = lambda *_: None
) -> list[Sensitivity]:
    """One curve per parameter, from the smallest searched to well beyond chosen and default."""
    search = Search(trials)
    everything = range(len(trials))
    counted = sum(int(np.count_nonzero(trial.labels != NOT_COUNTED)) for trial in trials)
    centre, default = point_of(chosen), point_of(PhasesConfig())
    curves = []
    for place, name in enumerate(SEARCHED):
        last = min(LARGEST[place], 2 * max(centre[place], default[place]))
        marks = np.linspace(SMALLEST[place], last, 25).round().astype(int)
        values = sorted({*(int(mark) for mark in marks), centre[place], default[place]})
        hits = []
        for value in values:
            v_eps, vz_min, align, pre = (
                value if place == at else centre[at] for at in range(len(SEARCHED))
            )
            hits.append(search.hits((v_eps, vz_min, align, pre), everything))
        step = SPEED_STEP_MM_S if place < 2 else DWELL_STEP_S
        curves.append(
            Sensitivity(
                name,
                np.array(values) * step,
                np.array(hits) / counted,
                centre[place] * step,
                default[place] * step,
            )
        )
        progress("looking around the optimum", (place + 1) / len(SEARCHED))
    return curves
