"""Algorithm 1 over a table."""

import csv
import io

import pytest

from tams_app.config import PhasesConfig
from tams_app.console.phases import label_phases
from tams_app.errors import ConfigError

pytestmark = pytest.mark.untimed

THRESHOLDS = PhasesConfig()
HEADER = "t_s,vx_mm_s,vy_mm_s,vz_mm_s,gripper\n"


def phases(text, smoothing_s=0.0):
    labelled = label_phases(text, "t.csv", THRESHOLDS, smoothing_s)
    return [row["phase"] for row in csv.DictReader(io.StringIO(labelled))]


def test_a_descent_becomes_align_once_it_has_lasted_the_dwell_time():
    rows = "".join(f"{i / 10},0,0,-50,0\n" for i in range(6))
    assert phases(HEADER + rows) == ["REACH"] * 3 + ["ALIGN"] * 3


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
