"""Whoever waits is told what for."""

from __future__ import annotations

import io
import time

import pytest

from tams_app.printing import Console
from tams_app.progress import waiting

pytestmark = pytest.mark.waiting


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
