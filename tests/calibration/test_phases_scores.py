"""Confusion, recall and the delays of switches, on labels written out by hand."""

from __future__ import annotations

import numpy as np
import pytest

from calibration.phases.trials import (
    CODE,
    NOT_COUNTED,
    Codes,
    Switches,
    Trial,
    TrialMotion,
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
    return Trial(TrialMotion("by hand", t_s, inputs), codes(labels))


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


@pytest.mark.parametrize(
    ("letter", "labels", "inferred", "delays_s", "missed", "spurious"),
    [
        ("A", "RRRAAAA", "RRRRRAA", (2.0,), 0, 0),  # late
        ("A", "RRRAAAA", "RAAAAAA", (-2.0,), 0, 0),  # early
        ("A", "RRAATT", "RRRRTT", (), 1, 0),  # never made
        ("A", "RRRRRR", "RAARAR", (), 0, 2),  # without a true one
        ("A", "RAAAAAA", "RARARAA", (0.0,), 0, 2),  # flicker within a true phase
        ("A", "RAARAA", "RAAAAA", (0.0,), 1, 0),  # two true switches need two inferred ones
        ("R", "RRRAA", "RRRAA", (), 0, 0),  # what begins with the trial is no switch
        ("R", "..RRA", "RRRRA", (), 0, 0),
        ("A", "..RRR", ".ARRR", (), 0, 0),  # inferred where nothing counts
        ("O", "T..RR", "TTOOR", (), 0, 0),
        ("O", "T..RR", "TTTOR", (), 0, 1),
    ],
)
def test_a_switch_is_found_with_its_delay_or_missed_or_spurious(
    letter, labels, inferred, delays_s, missed, spurious
) -> None:
    t_s = np.arange(len(labels), dtype=np.float64)
    found = switches_into(LETTERS[letter], t_s, codes(labels), codes(inferred))
    assert found == Switches(delays_s, missed, spurious)


def test_percentiles_of_no_delays_are_unknown() -> None:
    assert Switches((), 0, 0).percentile_s(50) is None
    assert Switches((1.0, 3.0), 0, 0).percentile_s(50) == pytest.approx(2.0)
