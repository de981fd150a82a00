"""Algorithm 1 over a table."""

import csv
import io

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.config import PhasesConfig
from tams_app.console.phases import label_phases
from tams_app.errors import ConfigError

pytestmark = pytest.mark.untimed

THRESHOLDS = PhasesConfig()
HEADER = "t_s,vx_mm_s,vy_mm_s,vz_mm_s,gripper\n"


HELD = "pause: phase held"


def labels(text, smoothing_s=0.0, thresholds=THRESHOLDS):
    """Phase and reason of each row."""
    labelled = label_phases(text, "t.csv", thresholds, smoothing_s)
    return [(row["phase"], row["reason"]) for row in csv.DictReader(io.StringIO(labelled))]


def phases(text, *given):
    return [phase for phase, _ in labels(text, *given)]


FACTORS = st.sampled_from([0.0, 0.5, 1 - 1e-7, 1.0, 1 + 1e-7, 3.0])  # of the threshold
AXES = st.sampled_from([(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, 0, -1)])


@given(st.floats(0.01, 100.0), st.lists(st.tuples(FACTORS, AXES), min_size=1))
def test_without_smoothing_a_speed_at_the_threshold_is_held_whatever_came_before(v_eps, speeds):
    rows = [[factor * v_eps * part for part in axis] for factor, axis in speeds]
    text = HEADER + "".join(f"{t},{x},{y},{z},0\n" for t, (x, y, z) in enumerate(rows))
    found = labels(text, 0.0, PhasesConfig(v_eps_mm_s=v_eps))
    assert [reason == HELD for _, reason in found] == [max(map(abs, row)) <= v_eps for row in rows]


def test_without_smoothing_the_norm_of_whole_speeds_is_exact():
    found = labels(HEADER + "0,30,40,0,0\n1,3,4,0,0\n2,0,-3,4,0\n3,3,4,0.001,0\n")
    assert [reason == HELD for _, reason in found] == [False, True, True, False]


@given(st.floats(0.3, 100.0), st.sampled_from([(1.0, "REACH"), (1.0000001, "ALIGN")]))
def test_without_smoothing_a_descent_at_the_threshold_is_none(vz_min, case):
    factor, phase = case
    thresholds = PhasesConfig(vz_min_mm_s=vz_min, v_eps_mm_s=0.1, align_dwell_s=0.05)
    rows = "".join(f"{n / 10},50,0,{-vz_min * factor},0\n" for n in range(4))
    assert phases(HEADER + rows, 0.0, thresholds) == ["REACH", *[phase] * 3]


def test_the_first_row_has_no_gripper_edge():
    assert phases(HEADER + "0,100,0,0,1\n0.1,100,0,0,1\n0.2,0,0,0,0\n") == [
        "TRANSPORT",
        "TRANSPORT",
        "RELEASE",
    ]


def test_smoothing_delays_what_raw_speeds_show_at_once():
    rows = "0,0,0,0,0\n" + "".join(f"{i / 100},0,0,-50,0\n" for i in range(1, 60))
    raw, smooth = phases(HEADER + rows), phases(HEADER + rows, 0.1)
    assert raw.index("ALIGN") < smooth.index("ALIGN")


def test_further_columns_are_kept_and_two_are_added():
    labelled = label_phases(
        "note,t_s,vx_mm_s,vy_mm_s,vz_mm_s,gripper\nhi,0,0,0,0,0\n", "t.csv", THRESHOLDS, 0.0
    )
    assert labelled.splitlines() == [
        "note,t_s,vx_mm_s,vy_mm_s,vz_mm_s,gripper,phase,reason",
        "hi,0,0,0,0,0,REACH,pause: phase held",
    ]


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("t_s,vx_mm_s\n", "t.csv: lacks the column vy_mm_s"),
        (HEADER, "t.csv: has no rows"),
        (HEADER + "0,0,0\n", "t.csv: line 2: has not as many cells"),
        (HEADER + "0,0,0,0,0,9\n", "t.csv: line 2: has not as many cells"),
        (HEADER + "0,0,0,x,0\n", "t.csv: line 2: vz_mm_s is 'x'"),
        (HEADER + "0,0,0,nan,0\n", "t.csv: line 2: vz_mm_s is 'nan'"),
        (HEADER + "0,0,0,0,2\n", "t.csv: line 2: gripper is '2'"),
        (HEADER + "1,0,0,0,0\n0,0,0,0,0\n", "t.csv: line 3: t_s goes back"),
        (HEADER + "0,0,0,0,0\n\n\n1,0,0,x,0\n", "t.csv: line 5: vz_mm_s is 'x'"),
        ("note," + HEADER + 'a,0,0,0,0,0\n"b\nb",1,0,0,0,0\nc,2,x,0,0,0\n', "t.csv: line 5: vx"),
        ("a,a," + HEADER + "1,2,0,0,0,0,0\n", "t.csv: has the column 'a' more than once"),
        ("t_s," + HEADER + "0,0,0,0,0,0\n", "t.csv: has the column 't_s' more than once"),
        ("phase," + HEADER + "ALIGN,0,0,0,0,0\n", "t.csv: has a column phase already"),
        ("reason," + HEADER + "why,0,0,0,0,0\n", "t.csv: has a column reason already"),
        ("x" * 131073 + "," + HEADER, "t.csv: line 1: field larger than field limit"),
        (HEADER + "0,0,0,0,0\n" + "1" * 131073 + ",0,0,0,0\n", "t.csv: line 3: field larger"),
    ],
)
def test_bad_tables_are_refused_with_the_line_and_the_reason(text, sentence):
    with pytest.raises(ConfigError, match=sentence.replace("?", r"\?")):
        label_phases(text, "t.csv", THRESHOLDS, 0.0)
