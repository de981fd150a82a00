"""`report` as a person meets it: which log it takes, and what it says of one that is not whole."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

from tams_app.console.report import report_session
from tams_app.errors import LogError
from tams_app.recording.mcap_log import McapLog
from tests.synthetic_session import header, tick

pytestmark = pytest.mark.untimed


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A session folder with a whole log."""
    folder = tmp_path / "session"
    folder.mkdir()
    log = McapLog(folder / "session.mcap", header())
    for number in range(300):
        log.write(tick(number), 0)
        if number % 100 == 99:
            log.flush()
    log.close()
    return folder


def reported(path: Path) -> str:
    output = io.StringIO()
    report_session(path, Console(file=output, width=80))
    return output.getvalue()


def test_a_whole_log_is_reported_without_a_warning(folder: Path) -> None:
    text = reported(folder)
    assert "300 ticks" in text
    assert "The log" not in text
    assert (folder / "summary.json").exists()


def test_the_log_itself_may_be_given_for_its_folder(folder: Path) -> None:
    assert "300 ticks" in reported(folder / "session.mcap")
    assert (folder / "summary.json").exists()


def test_a_log_that_is_cut_off_says_so_in_one_line_after_the_table(folder: Path) -> None:
    log = folder / "session.mcap"
    log.write_bytes(log.read_bytes()[: log.stat().st_size // 2])
    lines = reported(folder).splitlines()
    (at,) = (number for number, line in enumerate(lines) if line.startswith("The log ends early"))
    assert lines[at].endswith("these figures cover only what was written before.")
    assert any("ticks" in line for line in lines[:at])


def test_a_damaged_log_says_so_in_one_line_after_the_table(folder: Path) -> None:
    log = folder / "session.mcap"
    data = bytearray(log.read_bytes())
    data[len(data) // 2] ^= 4
    log.write_bytes(data)
    lines = reported(folder).splitlines()
    (at,) = (number for number, line in enumerate(lines) if line.startswith("The log is damaged"))
    assert any("ticks" in line for line in lines[:at])


@pytest.mark.parametrize(
    ("given", "sentence"),
    [
        ("nowhere", "there is no such folder: give a session folder"),
        ("empty", r"holds no session\.mcap: give a session folder"),
        ("file.txt", r"is not a session: give the folder that holds session\.mcap"),
    ],
)
def test_what_is_no_session_is_refused_in_one_clear_sentence(
    tmp_path: Path, given: str, sentence: str
) -> None:
    (tmp_path / "empty").mkdir()
    (tmp_path / "file.txt").touch()
    with pytest.raises(LogError, match=f"{given}: {sentence}$"):
        reported(tmp_path / given)
