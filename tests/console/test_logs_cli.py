"""`log list`, `log show` and `log csv` over logs as sessions leave them."""

from __future__ import annotations

import csv
import json
import shutil
from functools import partial
from pathlib import Path

import pytest

from tams_app.cli import _main
from tams_app.recording.tables import flat
from tams_app.records import Note
from tests.synthetic_session import START_NS, header, tick, write_log

pytestmark = pytest.mark.untimed

TICKS = 120


@pytest.fixture(scope="module")
def written(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A session that was reported, one that was not, and things that are no sessions."""
    logs = tmp_path_factory.mktemp("logs")
    for name in ("20260101-100000-run", "20260101-110000-run"):
        folder = logs / name
        folder.mkdir()
        note = Note(START_NS + 5, "info", "ready, by hand")
        write_log(folder / "session.mcap", [*map(tick, range(TICKS)), note])
    assert _main(["report", str(logs / "20260101-100000-run"), "--json"]) == 0
    (logs / "notes.txt").write_text("none", encoding="utf-8")
    (logs / "empty").mkdir()
    return logs


@pytest.fixture
def logs(written: Path, tmp_path: Path) -> Path:
    """A copy of them."""
    return shutil.copytree(written, tmp_path, dirs_exist_ok=True)


@pytest.fixture
def out(tams):
    """Exit code, output and errors of a command of logs."""
    return partial(tams, "log")


def test_every_session_is_listed_with_what_it_came_to(logs: Path, out) -> None:
    code, text, _ = out("list", str(logs), "--json")
    assert code == 0
    first, second = json.loads(text)
    assert first["session"] == "20260101-100000-run"
    assert first["strategy"] == header().strategy
    assert first["duration_s"] > 0
    assert (second["strategy"], second["outcome"]) == (None, "no summary: run report")
    _, table, _ = out("list", str(logs))
    assert "20260101-110000-run" in table
    assert "notes.txt" not in table


def test_topics_are_told_with_their_number_and_times(logs: Path, out) -> None:
    _, text, _ = out("show", str(logs / "20260101-100000-run"), "--json")
    found = {one["topic"]: one for one in json.loads(text)}
    assert found["/tick"]["messages"] == TICKS
    assert found["/tick"]["first_s"] < found["/tick"]["last_s"] < 10
    assert found["/note"]["messages"] == 1
    _, table, _ = out("show", str(logs / "20260101-100000-run"))
    assert [line.split()[1] for line in table.splitlines() if "/tick" in line] == [str(TICKS)]


def test_the_messages_of_a_topic_are_json_lines(logs: Path, out) -> None:
    _, text, _ = out("show", str(logs / "20260101-100000-run"), "--topic", "/note")
    (note,) = map(json.loads, text.splitlines())
    assert (note["text"], note["level"]) == ("ready, by hand", "info")
    assert note["log_t_s"] >= 0


def test_a_topic_becomes_a_table_with_nested_fields_as_columns(logs: Path, out) -> None:
    _, text, _ = out("csv", str(logs / "20260101-100000-run"), "/tick")
    rows = list(csv.DictReader(text.splitlines()))
    assert len(rows) == TICKS
    assert float(rows[7]["controller.pose.position.0"]) == pytest.approx(
        tick(7).controller.pose.position[0]  # type: ignore[union-attr]
    )
    assert rows[0]["phase"] == tick(0).phase.value


def test_a_table_is_written_where_told_and_never_over_a_file(logs: Path, out) -> None:
    target = logs / "notes.csv"
    session = str(logs / "20260101-100000-run")
    code, text, _ = out("csv", session, "/note", "--out", str(target))
    assert (code, text.strip()) == (0, f"{target}: 1 rows")
    before = target.read_text(encoding="utf-8")
    code, _, error = out("csv", session, "/tick", "--out", str(target))
    assert code == 2
    assert "is there already" in error
    assert target.read_text(encoding="utf-8") == before
    missing = logs / "missing.csv"
    assert out("csv", session, "/nothing", "--out", str(missing))[0] == 2
    assert not missing.exists()


@pytest.mark.parametrize(
    "arguments", [("show",), ("show", "--json"), ("show", "--topic", "/tick"), ("csv", "/tick")]
)
def test_what_a_log_lacks_is_a_sentence_beside_the_output(
    logs: Path, out, arguments: tuple[str, ...]
) -> None:
    log = logs / "20260101-100000-run/session.mcap"
    whole = log.read_bytes()
    command, *others = arguments
    assert out(command, str(log.parent), *others)[2] == ""
    log.write_bytes(whole[: len(whole) * 2 // 3])
    code, text, error = out(command, str(log.parent), *others)
    assert (code, error.startswith("The log ends early, at ")) == (0, True)
    assert len(error.splitlines()) == 1
    assert "The log" not in text


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (("show", "{logs}/empty"), "holds no session.mcap"),
        (("show", "{logs}/nowhere"), "there is no such folder"),
        (("list", "{logs}/nowhere"), "cannot be read"),
        (("csv", "{logs}/20260101-100000-run", "/nothing"), "'/nothing' is not one of /"),
        (("show", "{logs}/20260101-100000-run", "--topic", "tick"), "did you mean /tick?"),
    ],
)
def test_what_is_not_there_is_one_sentence(logs: Path, out, arguments, sentence: str) -> None:
    code, _, error = out(*(argument.format(logs=logs) for argument in arguments))
    assert code in (1, 2)
    assert sentence in error
    assert len(error.splitlines()) == 1


def test_a_topic_without_messages_is_empty_and_no_error(logs: Path, out) -> None:
    session = f"{logs}/20260101-100000-run"
    assert out("show", session, "--topic", "/episode") == (0, "", "")
    assert out("csv", session, "/episode")[:2] == (0, "log_t_s\r\n")


def test_flat_keeps_every_value_under_its_path() -> None:
    nested = {"a": {"b": [1, None, {"c": "x"}]}, "d": True}
    assert flat(nested) == {"a.b.0": 1, "a.b.1": "", "a.b.2.c": "x", "d": True}
