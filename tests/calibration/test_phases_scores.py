"""Confusion, recall and the delays of switches, on labels written out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.phases.trials import (
    CODE,
    NOT_COUNTED,
    Codes,
    Motion,
    Switches,
    Trial,
    score,
    switches_into,
)
from tams_app.records import Phase

pytestmark = pytest.mark.untimed

LETTERS = {
    "R": CODE[Phase.REACH],
    "A": CODE[Phase.ALIGN],
    "G": CODE[Phase.GRASP],
    "T": CODE[Phase.TRANSPORT],
    "P": CODE[Phase.PRE_RELEASE],
    "O": CODE[Phase.RELEASE],
    ".": NOT_COUNTED,
}


def codes(text: str) -> Codes:
    return np.array([LETTERS[letter] for letter in text], np.int8)


def trial(labels: str) -> Trial:
    """One tick a second."""
    t_s = np.arange(len(labels), dtype=np.float64)
    inputs = tuple((0.0, 0.0, False, 1.0) for _ in labels)
    return Trial(Motion("by hand", t_s, inputs), codes(labels))


def into(letter: str, labels: str, inferred: str) -> Switches:
    t_s = np.arange(len(labels), dtype=np.float64)
    return switches_into(LETTERS[letter], t_s, codes(labels), codes(inferred))


def test_every_counted_tick_is_in_the_confusion_once() -> None:
    scores = score([trial("..RRAAGT")], [codes("RRRAAAGG")])
    assert scores.ticks == 6
    assert scores.confusion[CODE[Phase.REACH], CODE[Phase.ALIGN]] == 1
    assert scores.confusion[CODE[Phase.TRANSPORT], CODE[Phase.GRASP]] == 1
    assert scores.accuracy == pytest.approx(4 / 6)
    assert scores.recall(Phase.REACH) == pytest.approx(1 / 2)
    assert scores.recall(Phase.RELEASE) is None
    assert scores.mean_recall == pytest.approx((0.5 + 1.0 + 1.0 + 0.0) / 4)


def test_scores_of_several_trials_add_up() -> None:
    together = score([trial("RRA"), trial("RAA")], [codes("RRR"), codes("RAA")])
    assert together.ticks == 6
    assert together.accuracy == pytest.approx(5 / 6)
    assert together.switches[Phase.ALIGN] == Switches((0.0,), missed=1, spurious=0)


def test_a_late_switch_has_a_positive_delay_and_an_early_one_a_negative() -> None:
    assert into("A", "RRRAAAA", "RRRRRAA").delays_s == (2.0,)
    assert into("A", "RRRAAAA", "RAAAAAA").delays_s == (-2.0,)


def test_a_switch_that_is_never_made_is_missed() -> None:
    assert into("A", "RRAATT", "RRRRTT") == Switches((), missed=1, spurious=0)


def test_a_switch_without_a_true_one_is_spurious() -> None:
    assert into("A", "RRRRRR", "RAARAR") == Switches((), missed=0, spurious=2)


def test_flicker_within_a_true_phase_is_found_once_and_spurious_after() -> None:
    assert into("A", "RAAAAAA", "RARARAA") == Switches((0.0,), missed=0, spurious=2)


def test_two_true_switches_need_two_inferred_ones() -> None:
    assert into("A", "RAARAA", "RAAAAA") == Switches((0.0,), missed=1, spurious=0)


def test_what_begins_with_the_trial_is_no_switch() -> None:
    assert into("R", "RRRAA", "RRRAA") == Switches((), missed=0, spurious=0)
    assert into("R", "..RRA", "RRRRA") == Switches((), missed=0, spurious=0)


def test_what_is_inferred_where_nothing_counts_is_not_spurious() -> None:
    assert into("A", "..RRR", ".ARRR") == Switches((), missed=0, spurious=0)
    assert into("O", "T..RR", "TTOOR") == Switches((), missed=0, spurious=0)
    assert into("O", "T..RR", "TTTOR") == Switches((), missed=0, spurious=1)


def test_percentiles_of_no_delays_are_unknown() -> None:
    assert Switches((), 0, 0).percentile_s(50) is None
    assert Switches((1.0, 3.0), 0, 0).percentile_s(50) == pytest.approx(2.0)
