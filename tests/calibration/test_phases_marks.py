"""Marks of phase changes: kept, read back, refused with the line, and made on a replay as text."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from calibration.phases.marking import (
    CURSOR_COLUMN,
    HELP,
    Mark,
    Marking,
    Replay,
    add_mark,
    labels_from,
    mark_trial,
    phase_named,
    read_marks,
    replay_of,
    strip,
    without_mark,
    write_marks,
)
from calibration.phases.trials import CODE, NOT_COUNTED, motion_of
from tams_app.errors import ConfigError, TamsError
from tams_app.records import Phase
from tests.calibration.phase_trials import WHOLE, session, walk
from tests.scripted_ui import ScriptedUI

pytestmark = pytest.mark.untimed

LAST_S = 8.0
SOME = [Mark(1.0, Phase.REACH), Mark(2.5, Phase.ALIGN), Mark(4.0, None)]


@pytest.fixture(scope="module")
def replay() -> Replay:
    ticks, _ = session(walk(WHOLE))
    return replay_of(motion_of("a trial", ticks, ticks[0].started_ns, 100.0), ticks)


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


def test_a_phase_holds_from_its_mark_to_the_next_and_nothing_before_the_first() -> None:
    t_s = np.array([0.0, 0.99, 1.0, 2.49, 2.5, 3.9, 4.0, 7.0])
    nothing, reach, align = NOT_COUNTED, CODE[Phase.REACH], CODE[Phase.ALIGN]
    expected = [nothing, nothing, reach, reach, align, align, nothing, nothing]
    assert labels_from(SOME, t_s).tolist() == expected
    assert labels_from([], t_s).tolist() == [nothing] * 8


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


def test_marks_that_cannot_be_kept_are_one_sentence(tmp_path) -> None:
    with pytest.raises(TamsError, match=r"gone/phases.csv: cannot be written"):
        write_marks(tmp_path / "gone" / "phases.csv", SOME)


def test_a_phase_may_be_named_by_any_beginning_that_no_other_has() -> None:
    assert phase_named("al") is Phase.ALIGN
    assert phase_named("pre") is Phase.PRE_RELEASE
    assert phase_named("pre-release") is Phase.PRE_RELEASE
    assert phase_named("-") is None
    for unclear in ("re", "", "hover"):
        with pytest.raises(ConfigError, match="is no phase"):
            phase_named(unclear)


def test_a_mark_at_the_time_of_another_takes_its_place() -> None:
    changed = add_mark(SOME, Mark(2.5, Phase.GRASP), LAST_S)
    assert changed == [SOME[0], Mark(2.5, Phase.GRASP), SOME[2]]


def test_a_phase_does_not_begin_anew_where_the_mark_between_is_gone() -> None:
    again = [*SOME[:2], Mark(3.0, Phase.REACH), Mark(4.0, None)]
    assert without_mark(again, again[1]) == [SOME[0], SOME[2]]
    assert without_mark(SOME, SOME[0]) == SOME[1:]


# --- marking on a replay ------------------------------------------------------------------------


def test_the_cursor_steps_jumps_and_stays_inside_the_log(replay) -> None:
    marking = Marking(replay, [])
    for command, at_s in [
        ("", 1.0),
        ("+0.25", 1.25),
        ("-0.5", 0.75),
        ("b", 0.0),
        ("5.5", 5.5),
        ("1000", pytest.approx(replay.last_s, abs=1e-3)),
        ("-1000", 0.0),
    ]:
        assert marking.handle(command) is False
        assert marking.cursor_s == at_s


def test_g_goes_to_each_command_of_the_gripper_in_turn(replay) -> None:
    marking = Marking(replay, [])
    edges = replay.t_s[np.flatnonzero(np.diff(replay.closed)) + 1]
    for edge in edges:
        marking.handle("g")
        assert marking.cursor_s == pytest.approx(edge, abs=1e-3)
    with pytest.raises(ConfigError, match="nothing more"):
        marking.handle("g")


def test_a_phase_is_marked_at_the_cursor_or_at_a_time(replay) -> None:
    marking = Marking(replay, [])
    assert marking.handle("2.0 align")
    assert marking.cursor_s == 2.0
    marking.handle("1.0")
    assert marking.handle("rea")
    assert marking.marks == [Mark(1.0, Phase.REACH), Mark(2.0, Phase.ALIGN)]
    assert marking.handle("undo")
    assert marking.marks == [Mark(2.0, Phase.ALIGN)]


def test_the_very_end_of_the_log_can_be_marked(replay) -> None:
    marking = Marking(replace(replay, t_s=replay.t_s + 0.0006), [])
    marking.handle("1000")
    assert marking.handle("-")


def test_marks_that_something_was_taken_out_of_can_be_gone_on_with(replay, tmp_path: Path) -> None:
    path = tmp_path / "phases.csv"
    mark_trial(
        ScriptedUI(["1.0 reach", "2.0 align", "3.0 reach", "2.5", "undo", "q"]), replay, path
    )
    assert mark_trial(ScriptedUI(["Q"]), replay, path) == [SOME[0]]


def test_what_can_be_typed_is_told_again_when_asked_for(replay, tmp_path: Path) -> None:
    ui = ScriptedUI(["?", "q"])
    mark_trial(ui, replay, tmp_path / "phases.csv")
    assert sum(HELP in text for text in ui.said) == 2


@pytest.mark.parametrize("command", ["align now", "1.0 2.0 align", "1.0 2.0", "?", "x align"])
def test_what_is_no_command_changes_nothing(replay, command) -> None:
    marking = Marking(replay, list(SOME))
    with pytest.raises(ConfigError):
        marking.handle(command)
    assert marking.marks == SOME


def test_marks_are_kept_at_once_and_gone_on_with_later(replay, tmp_path: Path) -> None:
    path = tmp_path / "phases.csv"
    interrupted = ScriptedUI(["1.0 reach", "2.5 align"])
    with pytest.raises(ConfigError):  # no more answers: as if the terminal went away
        mark_trial(interrupted, replay, path)
    assert read_marks(path, replay.last_s) == SOME[:2]
    later = ScriptedUI(["4.0 -", "q"])
    assert mark_trial(later, replay, path) == SOME
    assert read_marks(path, replay.last_s) == SOME
    assert any("2 marks so far" in text for text in later.said)


def test_a_wrong_command_is_answered_with_what_is_wrong(replay, tmp_path: Path) -> None:
    ui = ScriptedUI(["1.0 hover", "q"])
    mark_trial(ui, replay, tmp_path / "phases.csv")
    assert any("'hover' is no phase" in text for text in ui.said)
    assert not (tmp_path / "phases.csv").exists()


# --- what is shown ------------------------------------------------------------------------------


def rows(text: str) -> dict[str, str]:
    """The lines of a strip by the first word of their name."""
    named = {}
    for line in text.splitlines():
        words = line[:22].split()
        named[words[0] if words else ""] = line[23:]
    return named


def test_the_strip_shows_the_gripper_closing_where_it_does(replay) -> None:
    closes_s = float(replay.t_s[np.argmax(replay.closed)])
    gripper = rows(strip(replay, [], closes_s))["gripper"]
    assert gripper[CURSOR_COLUMN - 1 : CURSOR_COLUMN + 1] == "·█"


def test_the_strip_shows_descents_below_and_rises_above(replay) -> None:
    shown = rows(strip(replay, [], 2.5))  # half-way down to the block
    assert shown["down"][CURSOR_COLUMN] == "█"
    assert shown["up"][CURSOR_COLUMN] == " "


def test_the_strip_shows_the_marks_by_name_and_what_is_before_the_log_empty(replay) -> None:
    shown = rows(strip(replay, SOME, 1.0))
    assert shown["marked"][CURSOR_COLUMN:].startswith("|REACH")
    assert "|ALIGN" in shown["marked"]
    assert shown["marked"][: CURSOR_COLUMN - 10].strip() == ""


def test_the_strip_shows_no_phase_that_anybody_inferred(replay) -> None:
    assert not any(phase.value in strip(replay, [], 2.5) for phase in Phase)
