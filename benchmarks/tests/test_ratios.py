"""Pairs of runs to ratios, verdicts and what speaks against them."""

from __future__ import annotations

from statistics import median

import pytest
from hypothesis import given
from hypothesis import strategies as st

from benchmarks.ratios import MEASURES, Run, Side, cells, doubts, markdown, rows, turn

pytestmark = pytest.mark.untimed

CONTROL = "control_ms_per_tick"  # at most 0.35


def pairs(*values: tuple[float, float], key: str = CONTROL) -> list[Run]:
    return [
        Run(number, side, {key: value})
        for number, both in enumerate(values)
        for side, value in zip(Side, both, strict=True)
    ]


def test_the_sides_of_a_pair_take_turns_to_begin() -> None:
    assert [turn(pair)[0] for pair in range(3)] == [Side.BEFORE, Side.AFTER, Side.BEFORE]
    assert {turn(pair) for pair in range(3)} == {tuple(Side), tuple(Side)[::-1]}


@given(
    st.lists(st.tuples(st.floats(0.1, 10), st.floats(0.1, 10)), min_size=1, max_size=6),
    st.randoms(use_true_random=False),
)
def test_ratios_are_of_pairs_in_whatever_order_they_ran(values, random) -> None:
    runs = pairs(*values)
    random.shuffle(runs)
    (row,) = rows(runs)
    assert row.ratios == pytest.approx([after / before for before, after in values])
    assert (row.verdict == "met") == (median(row.ratios) <= 0.35)


def test_the_median_decides() -> None:
    (row,) = rows(pairs((1, 0.30), (1, 0.34), (1, 0.90)))
    assert row.verdict == "met"
    assert row.as_json()["ratio"] == {"min": 0.30, "median": 0.34, "max": 0.90}
    (row,) = rows(pairs((1, 0.30), (1, 0.36), (1, 0.90)))
    assert row.verdict == "missed"


def test_a_run_without_its_other_side_is_left_out_and_told() -> None:
    runs = pairs((2, 1), (4, 1), (2, 1))
    del runs[2]
    found = rows(runs)
    assert found[0].ratios == (0.5, 0.5)
    assert "control thread, a tick: 2 of 3 pairs." in doubts(found, 3)
    assert rows(runs[:1]) == []


def test_a_target_that_no_pair_has_measured_is_neither_met_nor_missed() -> None:
    (row,) = rows(pairs((0.0, 1.0)))
    assert row.verdict == ""
    assert row.as_json()["ratio"] is None


def test_fewer_than_three_pairs_are_told() -> None:
    assert "Fewer than 3 pairs" in doubts(rows(pairs((1, 1), (1, 1))), 2)[0]
    assert doubts(rows(pairs((1, 1), (1, 1), (1, 1))), 3) == []


def test_a_busy_machine_is_told() -> None:
    told = doubts(rows(pairs(*[(0.02, 0.02)] * 2, (0.02, 0.41), key="others_share")), 3)
    assert len(told) == 1
    assert "up to 41% of a core" in told[0]
    assert doubts(rows(pairs(*[(0.02, 0.02)] * 3, key="others_share")), 3) == []


def test_different_frame_rates_are_told() -> None:
    told = doubts(rows(pairs((5, 5), (5, 5), (4, 5), key="fps_given")), 3)
    assert len(told) == 1
    assert "differ by up to 25%" in told[0]


def test_sessions_that_did_not_do_the_same_work_are_told() -> None:
    told = doubts(rows(pairs((0.7, 0.7), (0.7, 0.6), (0.7, 0.1), key="engaged_share")), 3)
    assert len(told) == 1
    assert "differ by up to 60%" in told[0]
    assert doubts(rows(pairs(*[(0.7, 0.6)] * 3, key="engaged_share")), 3) == []


def test_what_is_no_cost_has_no_ratio() -> None:
    (row,) = rows(pairs((5, 4), key="fps_given"))
    assert row.ratios == ()
    assert cells(row)[1:4] == ("5 /s", "4 /s", "")


def test_the_table_has_a_line_for_every_measure_and_shows_what_was_missed() -> None:
    measures = {measure.key: 1.0 for measure in MEASURES}
    both = [Run(pair, side, measures) for pair in range(3) for side in Side]
    lines = markdown(rows(both)).splitlines()
    assert len(lines) == 2 + len(MEASURES)
    assert "| ≤ 0.35 | **missed** |" in next(line for line in lines if "control thread" in line)


def test_the_targets_are_those_that_were_agreed() -> None:
    targets = {measure.key: measure.target for measure in MEASURES if measure.target is not None}
    assert targets == {
        "beyond_share": 0.40,
        "control_ms_per_tick": 0.35,
        "rig_share": 0.50,
        "set_ms": 0.65,
        "virtual_cpu_s_per_s": 0.60,
    }
