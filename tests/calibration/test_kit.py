"""The terminal that a wizard talks through, and the file or pipe in its place."""

import io
import sys

import pytest
from rich.console import Console
from rich.prompt import Confirm
from rich.table import Table
from rich.text import Text

from calibration.kit import WizardUI
from tams_app.errors import ConfigError

pytestmark = pytest.mark.untimed

LIKE_MARKUP = "HD Cam [C920] at 0:on:3 [s], [mm], [/]"


@pytest.fixture
def paper():
    """A file in place of the terminal."""
    return Console(file=io.StringIO(), width=200)


@pytest.fixture
def terminal():
    return Console(file=io.StringIO(), width=200, force_terminal=True, color_system=None)


def type_in(monkeypatch, text):
    monkeypatch.setattr(sys, "stdin", io.StringIO(text))
    monkeypatch.setattr(sys.stdin, "isatty", lambda: True, raising=False)
    monkeypatch.setattr("builtins.input", lambda *_: sys.stdin.readline().rstrip())


def test_what_is_said_stays_to_the_letter_and_a_file_gets_no_state_of_what_is_measured(paper):
    with WizardUI(paper) as ui:
        ui.show(Text("12 %"))
        ui.print(LIKE_MARKUP)
        ui.show(Text("13 %"))
    assert paper.file.getvalue() == LIKE_MARKUP + "\n"


def test_a_question_stays_to_the_letter(terminal, monkeypatch):
    type_in(monkeypatch, "y\n")
    with WizardUI(terminal) as ui:
        assert ui.yes(LIKE_MARKUP)
    assert LIKE_MARKUP in terminal.file.getvalue()


def test_a_choice_names_what_each_answer_means_unless_it_says_so_itself(terminal, monkeypatch):
    type_in(monkeypatch, "LEFT\n")
    with WizardUI(terminal) as ui:
        assert ui.choice("Which?", {"left": "left", "0": "neither"}) == "left"
    assert "Which? (left, 0 = neither)" in terminal.file.getvalue()


@pytest.mark.parametrize("stdin", [io.StringIO("y\n"), None])
def test_without_a_terminal_nobody_is_asked_or_waited_for(paper, monkeypatch, stdin):
    monkeypatch.setattr(sys, "stdin", stdin)
    with WizardUI(paper) as ui:
        assert not ui.attended
        assert not ui.pressed()
        with pytest.raises(ConfigError, match="there is no terminal to ask at"):
            ui.yes("Write it?")


def test_what_is_shown_keeps_its_style_when_something_is_said_above_it(terminal):
    table = Table(box=None, show_header=False)
    table.add_row("[dim]towards the base[/]")
    with WizardUI(terminal) as ui:
        ui.show(table)
        ui.print(LIKE_MARKUP)
    assert LIKE_MARKUP in terminal.file.getvalue()
    assert "[dim]" not in terminal.file.getvalue()


def interrupted(*_):
    raise KeyboardInterrupt


def test_ctrl_c_while_the_live_area_opens_is_ctrl_c_and_gives_the_cursor_back(
    terminal, monkeypatch
):
    monkeypatch.setattr(terminal, "push_render_hook", interrupted)
    with pytest.raises(KeyboardInterrupt), WizardUI(terminal) as ui:
        ui.show(Text("12 %"))
    assert terminal.file.getvalue().endswith("\x1b[?25h")


def test_what_is_said_after_an_interrupted_question_is_not_held_back(paper, monkeypatch):
    ui = WizardUI(paper)
    monkeypatch.setattr(WizardUI, "attended", True)

    def interrupted_while_printing(*_, console, **__):
        console._enter_buffer()  # as print does, which a signal may end at any place
        interrupted()

    monkeypatch.setattr(Confirm, "ask", interrupted_while_printing)
    with pytest.raises(KeyboardInterrupt):
        ui.yes("Write it?")
    ui.print("Kept")
    assert "Kept" in paper.file.getvalue()
