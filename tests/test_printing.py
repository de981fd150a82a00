"""What a file holds is shown on the terminal and never obeyed by it."""

from __future__ import annotations

import io
import json
import re
import time
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st
from rich.table import Table
from rich.text import Text

from tams_app.cli import _main
from tams_app.printing import Console, PlainOutput, plain, waiting
from tests.study.synthetic_study import make_study

pytestmark = pytest.mark.untimed

OBEYED = re.compile("[\x00-\x08\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]")
HOSTILE = "\x1b]0;owned\x07\x1b[2J\x9b2J\r[/red][bold]x\u202e"
SHOWN = "]0;owned[2J2J[/red][bold]x"


def listed(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    assert _main([*map(str, arguments)]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert not OBEYED.search(printed.out)
    return printed.out


@pytest.mark.parametrize(
    ("summary", "shown"),
    [
        ({"strategy": "[/red]", "network": HOSTILE}, ["[/red]", SHOWN]),
        ({"strategy": "[bold]tams[/bold]"}, ["[bold]tams[/bold]"]),
        ({"outcome": {"reason": HOSTILE}}, [SHOWN]),
        ({"arm": 3, "outcome": {"success": True}}, ["not judged"]),
        ({"arm": {"stops": 3}, "outcome": ["x"], "duration_s": "x"}, ["not judged"]),
        ({"outcome": {"success": True, "completion_time_s": "x"}}, ["not judged"]),
        ({"strategy": {"[/]": HOSTILE}}, ["[/]"]),
    ],
)
def test_sessions_of_elsewhere_are_listed(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], summary: object, shown: list[str]
) -> None:
    session = tmp_path / "20260101-000000-x"
    session.mkdir()
    (session / "session.mcap").touch()
    (session / "summary.json").write_text(json.dumps(summary))
    out = " ".join(listed(capsys, "log", "list", tmp_path).split())
    for text in shown:
        assert text in out


def test_a_session_of_any_name_is_listed_and_one_with_a_deep_summary_too(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    session = tmp_path / "\x1b[2J[red]"
    session.mkdir()
    (session / "session.mcap").touch()
    (session / "summary.json").write_text("[" * 100_000)
    out = listed(capsys, "log", "list", tmp_path)
    assert "[2J[red]" in out
    assert "no summary: run report" in " ".join(out.split())


def test_a_study_of_elsewhere_is_shown(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = make_study(tmp_path / "study")
    file = study.path / "plan.json"
    plan = json.loads(file.read_text()) | {"name": HOSTILE}
    file.write_text(json.dumps(plan))
    assert SHOWN in listed(capsys, "study", "show", study.path)


def test_an_error_that_names_what_a_file_holds_is_one_plain_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _main(["report", str(tmp_path / "\x1b[2Jgone")]) == 2
    said = capsys.readouterr().err
    assert said.startswith(f"tams: {tmp_path}/[2Jgone: ")
    assert not OBEYED.search(said)


@given(st.text())
def test_nothing_that_is_printed_is_obeyed(text: str) -> None:
    table = Table("column", title=text)
    table.add_row(text)
    table.add_row(Text(text))
    file = io.StringIO()
    console = Console(file=file, width=200)
    for one in (text, Text(text), table):
        console.print(one)
    console.out(text)
    assert not OBEYED.search(file.getvalue())


def test_a_terminal_s_own_colours_stay() -> None:
    file = io.StringIO()
    Console(file=file, force_terminal=True, color_system="standard").print(
        "\x1b[31mred", style="bold", highlight=False
    )
    assert file.getvalue() == "\x1b[1m[31mred\x1b[0m\n"


def test_lines_and_columns_stay() -> None:
    assert plain("a\n\tb") == "a\n\tb"


PRINTED = "\x1b[2J,x\r\n"


class Screen(io.StringIO):
    def isatty(self) -> bool:
        return True


@pytest.mark.parametrize(("file", "shown"), [(Screen(), "[2J,x\n"), (io.StringIO(), PRINTED)])
def test_a_table_is_as_it_is_for_programs_and_plain_for_people(
    file: io.StringIO, shown: str
) -> None:
    PlainOutput(file).write(PRINTED)
    assert file.getvalue() == shown


@pytest.mark.parametrize("width", [30, 60])
def test_on_a_narrow_terminal_no_word_is_broken(width: int) -> None:
    sentence = "holding, stale video. The video is too old to steer by: wait until it is back"
    file = io.StringIO()
    terminal = Console(file=file, force_terminal=True, color_system=None, width=width)
    terminal.print(f"{sentence} /a/path/{'longer/' * 10}file", highlight=False, soft_wrap=True)
    *lines, last = file.getvalue().splitlines()
    assert " ".join(line.rstrip() for line in lines) == sentence
    assert len(lines) > 1
    assert all(len(line) <= width for line in lines)
    assert last.startswith("/a/path/")  # one piece, which can be copied


def test_a_command_stays_one_line_on_any_terminal_and_a_sentence_does_in_a_file() -> None:
    command = "replay: run_tams.py replay /a/folder/of/sessions --speed 2"
    for options in ({"force_terminal": True, "color_system": None}, {}):
        file = io.StringIO()
        console = Console(file=file, width=20, **options)
        console.print(command, highlight=False, soft_wrap=True, no_wrap=bool(options))
        assert file.getvalue() == f"{command}\n"


def test_elsewhere_than_on_a_terminal_it_is_one_line_before_the_work() -> None:
    output = io.StringIO()
    with waiting("writing [it]", Console(file=output, width=10)):
        assert output.getvalue() == "writing [it] …\n"
    assert output.getvalue() == "writing [it] …\n"


def test_on_a_terminal_it_is_shown_during_the_work_and_taken_away() -> None:
    output = io.StringIO()
    with waiting("writing it", Console(file=output, force_terminal=True, width=80)):
        while "writing it …" not in output.getvalue():
            time.sleep(0.01)
    assert output.getvalue().endswith("\x1b[1A\x1b[2K"), "the line is erased"


def test_a_quiet_console_is_told_nothing_and_errors_pass() -> None:
    output = io.StringIO()
    with pytest.raises(ValueError), waiting("writing it", Console(file=output, quiet=True)):
        raise ValueError
    assert not output.getvalue()
