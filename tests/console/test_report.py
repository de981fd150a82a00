"""`report` as a person meets it: which log it takes, and what it says of one that is not whole."""

from __future__ import annotations

import io
import json
import shlex
from collections.abc import Callable
from pathlib import Path

import pytest
from mcap.reader import make_reader

from tams_app.cli import _main
from tams_app.console import report
from tams_app.console.report import report_session
from tams_app.errors import LogError
from tams_app.printing import Console
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


@pytest.fixture
def undrawn(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without figure and page, which take most of the time."""
    monkeypatch.setattr(report, "_draw", lambda *_: None)


def reported(path: Path) -> str:
    output = io.StringIO()
    report_session(path, Console(file=output, width=80))
    return output.getvalue()


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize("given", ["", "session.mcap"])
def test_a_whole_log_is_reported_without_a_warning(folder: Path, given: str) -> None:
    text = reported(folder / given)
    assert text.startswith("writing summary and report …\n")
    assert "300 ticks" in text
    assert "The log" not in text
    assert (folder / "summary.json").exists()


def test_the_last_lines_say_what_to_open_and_how_to_see_it_again(tmp_path: Path) -> None:
    long = tmp_path / ("a folder's name " * 5)
    long.mkdir()
    McapLog(long / "session.mcap", header()).close()
    *_, page, again = reported(long).splitlines()
    assert page == f"report: {long / 'report.html'}"
    assert Path(page.removeprefix("report: ")).is_file()
    program, command, given = shlex.split(again.removeprefix("replay: "))
    assert (program, command, given) == ("run_tams.py", "replay", str(long))


@pytest.mark.usefixtures("undrawn")
def test_a_program_reads_the_summary_itself(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _main(["report", str(folder), "--json"]) == 0
    saved = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    told = capsys.readouterr()
    assert json.loads(told.out) == saved
    assert told.err == "writing summary and report …\n"


def damage(folder: Path) -> None:
    """One bit of the chunk in the middle."""
    log = folder / "session.mcap"
    with log.open("rb") as stream:
        summary = make_reader(stream).get_summary()
    assert summary is not None
    chunks = sorted(summary.chunk_indexes, key=lambda one: one.chunk_start_offset)
    chunk = chunks[len(chunks) // 2]
    data = bytearray(log.read_bytes())
    data[chunk.chunk_start_offset + chunk.chunk_length // 2] ^= 4
    log.write_bytes(data)


def cut_off(folder: Path) -> None:
    log = folder / "session.mcap"
    log.write_bytes(log.read_bytes()[: log.stat().st_size // 2])


@pytest.mark.usefixtures("undrawn")
@pytest.mark.parametrize(
    ("harm", "begin", "end"),
    [
        (cut_off, "The log ends early", "or the file was cut or damaged)."),
        (damage, "The log is damaged", "what was recorded at 0.8 to 1.7 s is missing."),
    ],
)
def test_a_log_that_is_not_whole_says_so_in_one_line_after_the_table(
    folder: Path, harm: Callable[[Path], None], begin: str, end: str
) -> None:
    harm(folder)
    lines = reported(folder).splitlines()
    (at,) = (number for number, line in enumerate(lines) if line.startswith(begin))
    assert lines[at].endswith(end)
    assert any("ticks" in line for line in lines[:at])
    assert harm is cut_off or any("200 ticks" in line for line in lines[:at]), "of three chunks"


@pytest.mark.usefixtures("undrawn")
def test_the_summary_of_a_damaged_log_says_what_is_missing_and_the_former_one_is_kept(
    folder: Path,
) -> None:
    reported(folder)
    whole = (folder / "summary.json").read_bytes()
    assert (json.loads(whole)["complete"], json.loads(whole)["missing"]) == (True, [])
    damage(folder)
    for _ in range(2):  # a second report does not lose it either
        reported(folder)
        summary = json.loads((folder / "summary.json").read_text())
        assert summary["complete"] is False
        (gap,) = summary["missing"]
        assert gap == {"start_s": 0.8333, "end_s": 1.6583}
        assert summary["control"]["ticks"] == 200
        assert (folder / "summary.json.before").read_bytes() == whole


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
