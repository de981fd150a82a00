"""The search recovers thresholds that it is not told, and a trial left out has no say."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from calibration.phases.fit import (
    CODE,
    LARGEST,
    NOT_COUNTED,
    PhaseFit,
    Point,
    Search,
    Trial,
    check_trials,
    evaluate,
    fit_thresholds,
    infer,
    score,
    thresholds_at,
)
from tams_app.config import PhasesConfig
from tams_app.errors import TamsError
from tams_app.records import Phase
from tests.calibration.phase_trials import motion

pytestmark = [
    pytest.mark.untimed,
    pytest.mark.timeout(600),
]  # searching takes its time on a busy machine
SMOOTHING_MS = 100.0
KNOWN = [  # v_ε, v_z^min, T_align, T_pre
    PhasesConfig(v_eps_mm_s=8.0, vz_min_mm_s=22.0, align_dwell_s=0.25, pre_release_dwell_s=0.5),
    PhasesConfig(v_eps_mm_s=3.0, vz_min_mm_s=9.0, align_dwell_s=0.6, pre_release_dwell_s=0.1),
    PhasesConfig(v_eps_mm_s=16.0, vz_min_mm_s=34.0, align_dwell_s=0.1, pre_release_dwell_s=0.3),
]


def labelled(truth: PhasesConfig, noise_mm_s: float = 0.0) -> list[Trial]:
    """Trials that Algorithm 1 with thresholds `truth` has labelled."""
    motions = [motion(seed, noise_mm_s) for seed in range(3)]
    return [Trial(each, infer(each, truth)) for each in motions]


def hidden(trials: Sequence[Trial], share: float) -> list[Trial]:
    """The trials with a share of their labels changed at random."""
    random = np.random.default_rng(5)
    changed = []
    for trial in trials:
        labels = trial.labels.copy()
        wrong = random.random(len(labels)) < share
        labels[wrong] = random.integers(0, 6, np.count_nonzero(wrong))
        changed.append(replace(trial, labels=labels))
    return changed


@cache
def defaults_trials() -> tuple[Trial, ...]:
    return tuple(labelled(PhasesConfig()))


@cache
def noisy_trials() -> tuple[Trial, ...]:
    return tuple(hidden(labelled(KNOWN[1], noise_mm_s=2.0), 0.05))


@cache
def fitted() -> PhaseFit:
    return fit_thresholds(labelled(KNOWN[0]), SMOOTHING_MS)


@cache
def fitted_to_noise() -> PhaseFit:
    return fit_thresholds(noisy_trials(), SMOOTHING_MS)


def test_every_counted_tick_is_in_the_confusion_once() -> None:
    reach, align, grasp, transport = (CODE[phase] for phase in list(Phase)[:4])
    none = NOT_COUNTED
    truth = np.array([none, none, reach, reach, align, align, grasp, transport], np.int8)
    said = np.array([reach, reach, reach, align, align, align, grasp, grasp], np.int8)
    trial = replace(defaults_trials()[0], labels=truth)
    scores = score([trial], [said])
    assert scores.ticks == 6
    assert scores.confusion[reach, align] == scores.confusion[transport, grasp] == 1
    assert scores.accuracy == pytest.approx(4 / 6)
    assert scores.recall(Phase.REACH) == pytest.approx(1 / 2)
    assert scores.recall(Phase.RELEASE) is None
    assert scores.mean_recall == pytest.approx((0.5 + 1.0 + 1.0 + 0.0) / 4)


@pytest.mark.parametrize("known", KNOWN[1:])
def test_without_noise_the_labels_are_met_exactly(known: PhasesConfig) -> None:
    trials = labelled(known)
    best = thresholds_at(Search(trials).best([0, 1, 2]), SMOOTHING_MS)
    assert evaluate(trials, best).accuracy == 1.0
    assert evaluate(trials, PhasesConfig()).accuracy < 1.0


def test_a_fit_tells_the_scores_of_what_it_chose_and_of_the_defaults() -> None:
    trials, found = labelled(KNOWN[0]), fitted()
    assert found.in_sample.accuracy == evaluate(trials, found.thresholds).accuracy == 1.0
    assert found.defaults.accuracy == evaluate(trials, PhasesConfig()).accuracy < 1.0
    alone = [evaluate([trials[place]], fold) for place, fold in enumerate(found.folds)]
    assert (found.left_out.confusion == sum(scores.confusion for scores in alone)).all()


def test_with_noise_it_does_at_least_as_well_as_the_thresholds_that_made_the_labels() -> None:
    found = fitted_to_noise()
    assert found.in_sample.accuracy >= evaluate(noisy_trials(), KNOWN[1]).accuracy
    assert found.left_out.accuracy > found.defaults.accuracy


def test_of_equally_good_thresholds_those_nearest_to_the_defaults_are_taken() -> None:
    trials = defaults_trials()
    assert thresholds_at(Search(trials).best([0, 1, 2]), SMOOTHING_MS) == PhasesConfig()


def test_a_dwell_of_zero_which_abolishes_a_phase_is_never_taken() -> None:
    none = PhasesConfig(align_dwell_s=0.0, pre_release_dwell_s=0.0)
    trials = labelled(none)
    moving = [trial.labels[1:] for trial in trials]
    assert not any((labels == CODE[Phase.TRANSPORT]).any() for labels in moving)
    *_, align, pre = Search(trials).best([0, 1, 2])
    assert min(align, pre) >= 1


def test_each_fold_has_the_thresholds_that_the_other_trials_alone_give() -> None:
    others = [trial for place, trial in enumerate(noisy_trials()) if place != 1]
    alone = thresholds_at(Search(others).best([0, 1]), SMOOTHING_MS)
    assert fitted_to_noise().folds[1] == alone


def test_the_same_trials_give_the_same_thresholds_in_any_order() -> None:
    backwards = Search(noisy_trials()[::-1]).best([0, 1, 2])
    assert thresholds_at(backwards, SMOOTHING_MS) == fitted_to_noise().thresholds


_POINTS = st.tuples(*(st.integers(0, largest) for largest in LARGEST))


@given(point=_POINTS, seed=st.integers(0, 2))
@settings(max_examples=50)
def test_hits_counted_by_halves_are_those_of_algorithm_1_as_a_whole(
    point: Point, seed: int
) -> None:
    trial = hidden([defaults_trials()[seed]], 0.3)[0]
    trial.labels[::7] = NOT_COUNTED  # no hit, whatever is inferred
    whole = infer(trial.motion, thresholds_at(point, SMOOTHING_MS))
    assert Search([trial]).hits(point, [0]) == np.count_nonzero(whole == trial.labels)


def test_a_threshold_at_an_end_of_the_range_is_named() -> None:
    found = fitted()
    assert found.at_the_edge == []
    smallest = replace(found, thresholds=thresholds_at((20, 60, 1, 60), SMOOTHING_MS))
    assert smallest.at_the_edge == ["align_dwell_s", "pre_release_dwell_s"]


def with_labels(trial: Trial, codes: Sequence[int]) -> Trial:
    """The trial with other ticks than those of `codes` not counted."""
    return replace(trial, labels=np.where(np.isin(trial.labels, codes), trial.labels, NOT_COUNTED))


def test_trials_that_cannot_tell_the_phases_apart_are_named() -> None:
    first, *others = defaults_trials()
    known = [code for code in CODE.values() if code != CODE[Phase.RELEASE]]
    opened = tuple((v, vz, False, dt) for v, vz, _, dt in first.motion.inputs)
    for trials, reason in (
        (
            [with_labels(trial, known) for trial in (first, *others)],
            "the phase RELEASE never occurs in the 3 trials",
        ),
        ([with_labels(first, []), *others], "made 0: is labelled nothing throughout"),
        (
            [with_labels(first, [CODE[Phase.REACH]]), *others],
            "made 0: is labelled REACH throughout",
        ),
        (
            [replace(first, motion=replace(first.motion, inputs=opened)), *others],
            "made 0: .* its gripper never closes",
        ),
    ):
        with pytest.raises(TamsError, match=reason):
            check_trials(trials)
