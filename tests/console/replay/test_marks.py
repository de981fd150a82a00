"""Marks of phase changes: kept, read back, refused with the line, made and undone."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tams_app.console.replay.marks import Mark, Marking, phase_named, read_marks, write_marks
from tams_app.errors import ConfigError, TamsError
from tams_app.records import Phase

pytestmark = pytest.mark.untimed

LAST_S = 8.0
SOME = [Mark(1.0, Phase.REACH), Mark(2.5, Phase.ALIGN), Mark(4.0, None)]


@st.composite
def marks(draw: st.DrawFn) -> list[Mark]:
    times = draw(st.lists(st.integers(0, 8000), unique=True, max_size=12))
    found: list[Mark] = []
    for time in sorted(times):
        kinds = [kind for kind in (*Phase, None) if not found or kind is not found[-1].phase]
        found.append(Mark(time / 1000, draw(st.sampled_from(kinds))))
    return found


@given(marks())
def test_marks_are_read_back_as_they_were_written(tmp_path_factory, written) -> None:
    path = tmp_path_factory.mktemp("marks") / "phases.csv"
    write_marks(path, written)
    assert read_marks(path, LAST_S) == written


@pytest.mark.parametrize(
    ("rows", "line", "reason"),
    [
        ("time,phase\n1,REACH\n", 1, "must be t_s,phase"),
        ("", 1, "must be t_s,phase"),
        ("t_s,phase\n1.0,REACH\nsoon,ALIGN\n", 3, "t_s is 'soon', not a time"),
        ("t_s,phase\n1.0,REACH\nnan,ALIGN\n", 3, "t_s is 'nan', not a time"),
        ("t_s,phase\n1.0,HOVER\n", 2, "'HOVER' is no phase; they are REACH, ALIGN"),
        ("t_s,phase\n1.0,REACH\n\n0.5,ALIGN\n", 4, "0.5 s does not come after 1 s"),
        ("t_s,phase\n1.0,REACH\n1.0,ALIGN\n", 3, "1 s does not come after 1 s"),
        ("t_s,phase\n1.0,REACH\n9.0,ALIGN\n", 3, "9 s is outside the log, which lasts 8.0 s"),
        ("t_s,phase\n-1.0,REACH\n", 2, "-1 s is outside the log"),
        ("t_s,phase\n1.0,REACH\n2.0,reach\n", 3, "REACH is marked at 1 s already"),
        ("t_s,phase\n1.0\n", 2, "has 1 cells, not 2"),
    ],
)
def test_bad_marks_are_refused_with_the_line(tmp_path, rows, line, reason) -> None:
    path = tmp_path / "phases.csv"
    path.write_text(rows, encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        read_marks(path, LAST_S)
    assert str(caught.value).startswith(f"{path}: line {line}: ")
    assert reason in str(caught.value)


def test_a_phase_may_be_named_by_any_beginning_that_no_other_has() -> None:
    assert phase_named("al") is Phase.ALIGN
    assert phase_named("pre") is Phase.PRE_RELEASE
    assert phase_named("pre-release") is Phase.PRE_RELEASE
    assert phase_named("-") is None
    for unclear in ("re", "", "hover"):
        with pytest.raises(ConfigError, match="is no phase"):
            phase_named(unclear)


@pytest.fixture
def marking(tmp_path: Path) -> Marking:
    """Of a log in which SOME are marked."""
    path = tmp_path / "phases.csv"
    write_marks(path, SOME)
    return Marking(path, LAST_S)


@pytest.mark.parametrize(
    ("phase", "t_s", "kept"),
    [
        (Phase.GRASP, 3.0, [*SOME[:2], Mark(3.0, Phase.GRASP), SOME[2]]),
        (Phase.GRASP, 2.5, [SOME[0], Mark(2.5, Phase.GRASP), SOME[2]]),  # in place of another
        (Phase.REACH, 2.5, [SOME[0], SOME[2]]),  # which goes on then
        (Phase.ALIGN, 2.0, [SOME[0], Mark(2.0, Phase.ALIGN), SOME[2]]),  # begins earlier
        (Phase.ALIGN, 3.0, SOME),  # is already
        (Phase.GRASP, 100.0, [*SOME, Mark(LAST_S, Phase.GRASP)]),
        (None, 0.0, [Mark(0.0, None), *SOME]),
    ],
)
def test_a_phase_begins_where_it_is_marked_and_holds_until_the_next(
    marking: Marking, tmp_path: Path, phase: Phase | None, t_s: float, kept: list[Mark]
) -> None:
    sentence = marking.begin(phase, t_s)
    assert ("already" in sentence) == (kept == SOME)
    assert marking.marks == kept
    assert read_marks(tmp_path / "phases.csv", LAST_S) == kept


def test_a_phase_does_not_begin_anew_where_the_mark_between_is_gone(
    marking: Marking, tmp_path: Path
) -> None:
    marking.begin(Phase.REACH, 3.0)
    assert "ALIGN" in marking.undo(2.999)
    assert marking.marks == [SOME[0], SOME[2]]
    assert read_marks(tmp_path / "phases.csv", LAST_S) == marking.marks


def test_what_was_marked_just_now_is_undone_though_its_time_is_rounded(marking: Marking) -> None:
    marking.begin(Phase.GRASP, 2.7996)
    assert "GRASP at 2.80 s" in marking.undo(2.7996)
    assert marking.marks == SOME


def test_where_nothing_is_marked_before_there_is_nothing_to_undo(marking: Marking) -> None:
    assert marking.undo(0.5) == "there is no mark before this"
    assert marking.marks == SOME


def test_what_cannot_be_kept_is_not_marked_and_the_marks_before_stay_whole(tmp_path: Path) -> None:
    folder = tmp_path / "log"
    folder.mkdir()
    marking = Marking(folder / "phases.csv", LAST_S)
    marking.begin(Phase.REACH, 1.0)
    folder.rename(tmp_path / "moved")
    with pytest.raises(TamsError, match="cannot be written"):
        marking.begin(Phase.ALIGN, 2.0)
    assert marking.marks == [SOME[0]] == read_marks(tmp_path / "moved" / "phases.csv", LAST_S)
