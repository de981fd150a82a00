"""`replay --recompute` says what differs, and its exit code whether anything does."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import pytest

from tams_app.cli import _main
from tams_app.recording import LOG_NAME, SessionLog, read_log
from tests.golden_logs import golden_log, write_thinned

pytestmark = pytest.mark.untimed


@pytest.fixture
def session(tmp_path: Path) -> Path:
    shutil.copy(golden_log("outage"), tmp_path / LOG_NAME)
    return tmp_path


@pytest.fixture
def changed_session(session: Path, tmp_path: Path) -> Path:
    """One target of a thousand kbit/s more, after ten seconds."""
    log: SessionLog = read_log(session / LOG_NAME)
    number = next(
        n for n, one in enumerate(log.allocations) if one.t_ns > log.header.started_ns + 10**10
    )
    one = log.allocations[number]
    log.allocations[number] = replace(
        one, target_kbps={view: kbps + 1000 for view, kbps in one.target_kbps.items()}
    )
    folder = tmp_path / "changed"
    folder.mkdir()
    write_thinned(log, folder / LOG_NAME)
    return folder


def test_a_log_that_comes_out_the_same_ends_with_code_0(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _main(["replay", str(session), "--recompute"]) == 0
    told = capsys.readouterr().out
    assert "Today's code does what the log says" in told
    assert "0.1.0" in told


def test_a_difference_is_told_with_its_time_and_ends_with_code_1(
    changed_session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _main(["replay", str(changed_session), "--recompute"]) == 1
    told = capsys.readouterr().out
    assert "Today's code does not do what the log says" in told
    (row,) = (line for line in told.splitlines() if "targets" in line)
    assert "1e+03 kbit/s" in row
    assert "10.0" in row


def test_as_json_each_quantity_has_its_figures(
    changed_session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert _main(["replay", str(changed_session), "--recompute", "--json"]) == 1
    captured = capsys.readouterr()
    assert captured.err == "reading the log and computing it anew …\n"
    told = json.loads(captured.out)
    assert told["same"] is False
    assert told["complete"] is True
    (targets,) = (one for one in told["quantities"] if one["name"] == "targets")
    assert (targets["differing"], targets["largest"]) == (1, 1000.0)
    assert targets["first_s"] == pytest.approx(10.0, abs=0.1)


def test_what_a_log_lacks_is_told_beside_the_comparison(
    session: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = session / LOG_NAME
    log.write_bytes(log.read_bytes()[: log.stat().st_size * 2 // 3])
    _main(["replay", str(session), "--recompute"])
    assert "The log ends early, at " in capsys.readouterr().out
    _main(["replay", str(session), "--recompute", "--json"])
    assert json.loads(capsys.readouterr().out)["complete"] is False


def test_a_log_of_an_older_version_is_one_sentence(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    log = read_log(golden_log("outage"))
    log.ticks[:] = [replace(tick, inputs=None) for tick in log.ticks]
    write_thinned(log, tmp_path / LOG_NAME)
    assert _main(["replay", str(tmp_path), "--recompute"]) == 2
    told = capsys.readouterr().err
    assert told.count("\n") == 1
    assert "schema 4 or newer" in told


def test_json_without_recompute_is_refused(session: Path) -> None:
    assert _main(["replay", str(session), "--json"]) == 2
