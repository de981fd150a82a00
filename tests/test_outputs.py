"""A folder that came from elsewhere: nothing is written, made or deleted outside of it."""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from tams_app.config import DEFAULT_CONFIG
from tams_app.errors import ConfigError, LogError
from tams_app.outputs import inner_folder, is_plain_name, new_file, write_file
from tams_app.records import Phase
from tests.export.sessions import head, moving_session, write_session
from tests.study.synthetic_study import PlantedRunner, fill_study, make_study

pytestmark = pytest.mark.untimed

LINKED = "is a symbolic link, and results are not written through one: remove it"


@pytest.fixture
def victim(tmp_path: Path) -> Iterator[Path]:
    """A file and a folder of the user's, which are the same afterwards."""
    folder = tmp_path / "precious"
    folder.mkdir()
    file = folder / "file"
    file.write_text("precious\n")
    yield file
    assert file.read_text() == "precious\n"
    assert list(folder.iterdir()) == [file]


@pytest.fixture
def session(tmp_path: Path) -> Path:
    return moving_session(tmp_path / "foreign" / "session")


@pytest.fixture
def told(tams: Callable[..., tuple[int, str, str]]) -> Callable[..., tuple[int, str]]:
    """Exit code of a command, and what was said on standard error."""
    return lambda *arguments: tams(*arguments)[::2]


@pytest.mark.parametrize(
    ("name", "dangling"),
    [
        ("summary.json", False),
        ("summary.json", True),
        ("report.html", False),
        ("bitrates.png", True),
    ],
)
def test_report_writes_through_no_link(
    session: Path,
    victim: Path,
    told: Callable[..., tuple[int, str]],
    name: str,
    dangling: bool,
) -> None:
    (session / name).symlink_to(victim.with_name("new") if dangling else victim)
    code, said = told("report", session)
    assert (code, said) == (2, f"tams: {session / name}: {LINKED}\n")


def test_a_summary_kept_from_before_is_not_written_through_a_link(
    session: Path, victim: Path, told: Callable[..., tuple[int, str]]
) -> None:
    assert told("report", session) == (0, "")
    log = session / "session.mcap"
    log.write_bytes(log.read_bytes()[:-200])  # cut off: the complete summary is kept
    (session / "summary.json.before").symlink_to(victim)
    assert told("report", session) == (
        2,
        f"tams: {session / 'summary.json.before'}: {LINKED}\n",
    )
    assert json.loads((session / "summary.json").read_text())["complete"]


@pytest.mark.parametrize("name", ["tables", "report", "tables/trials.csv", "report/report.html"])
def test_a_study_s_report_follows_no_link(
    tmp_path: Path,
    victim: Path,
    told: Callable[..., tuple[int, str]],
    monkeypatch: pytest.MonkeyPatch,
    name: str,
) -> None:
    from tams_app.study.report import build  # of an extra

    monkeypatch.setattr(build, "build_report", lambda *_: build.Report("a page", {}))
    study = make_study(tmp_path / "study")
    fill_study(study, PlantedRunner())
    link = study.path / name
    link.parent.mkdir(exist_ok=True)
    link.symlink_to(victim if "/" in name else victim.parent)
    code, said = told("study", "report", study.path)
    assert code == 2
    assert said.splitlines()[-1] == f"tams: {link}: {LINKED}"


@pytest.mark.parametrize("name", ["plan.json", ".lock", "trials", "trials/P01"])
def test_a_study_s_own_files_and_folders_are_no_links(
    tmp_path: Path, victim: Path, name: str
) -> None:
    study = make_study(tmp_path / "study")
    plan, link = study.load(), study.path / name
    if link.is_file():
        link.unlink()
    link.parent.mkdir(exist_ok=True)
    link.symlink_to(victim if "." in name else victim.parent)
    with pytest.raises(ConfigError, match=re.escape(f"{link}: {LINKED}")), study.locked():
        study.new_attempt(plan, plan.trials[0].id)


@pytest.mark.parametrize("name", ["tables", "report", "trials", "trials/P01"])
def test_forgetting_deletes_nothing_behind_a_link(tmp_path: Path, victim: Path, name: str) -> None:
    study = make_study(tmp_path / "study")
    link = study.path / name
    link.parent.mkdir(exist_ok=True)
    behind = victim.parent
    if name == "trials":
        behind = tmp_path / "others"
        (behind / "P01").mkdir(parents=True)
        (behind / "P01" / "kept").touch()
    link.symlink_to(behind)
    with pytest.raises(ConfigError, match="is a symbolic link"):
        study.forget(study.load(), "P01")
    assert name != "trials" or (behind / "P01" / "kept").exists()


@pytest.mark.parametrize(
    "change",
    [
        {"id": "../../../escaped"},
        {"id": "/escaped"},
        {"id": ".."},
        {"id": ""},
        {"participant": "../P01"},
        {"attempts": [{"folder": "../../escaped"}]},
        {"attempts": [{"folder": "/etc"}]},
    ],
)
def test_a_plan_names_nothing_outside_of_its_study(
    tmp_path: Path, told: Callable[..., tuple[int, str]], change: dict[str, object]
) -> None:
    study = make_study(tmp_path / "study")
    file = study.path / "plan.json"
    plan = json.loads(file.read_text())
    plan["trials"][0] |= change
    file.write_text(json.dumps(plan))
    for command in ("show", "run"):
        code, said = told("study", command, study.path, *["--sim"] * (command == "run"))
        assert (code, said.count("\n")) == (2, 1)
        assert said.startswith(f"tams: {file}: trials.0.")
    assert sorted(path.name for path in tmp_path.iterdir()) == ["study"]


@pytest.mark.parametrize("view", ["x/../../../../escaped", "/escaped", "..", "", "a\nb"])
def test_an_exported_view_names_no_path(
    tmp_path: Path, told: Callable[..., tuple[int, str]], view: str
) -> None:
    weights = {phase: {"eih": 0.5, view: 0.5} for phase in Phase}
    header = head(views=["eih", view], weights=weights)
    log = write_session(tmp_path / "in" / "session", header_of=header)
    code, said = told("export", log, "--format", "lerobot", "--out", tmp_path / "in/deep/dataset")
    assert (code, said.count("\n")) == (2, 1)
    assert f"a view is named {view!r}: cannot be a folder" in said
    assert [path.name for path in tmp_path.rglob("*")] == ["in", "session", "session.mcap"]


def test_names_of_folders_are_plain() -> None:
    assert all(map(is_plain_name, ["eih", "P01-01", "P01-01-a2", "view_1.5", "übersicht"]))
    assert not any(
        map(is_plain_name, ["", ".", "..", ".lock", "a/b", "a\0", "a\n", "a b", "x" * 101])
    )


def test_a_folder_that_is_no_plain_name_is_not_made(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="cannot be the name of a folder"):
        inner_folder(tmp_path, "..", "elsewhere")


def test_a_file_that_fails_leaves_the_old_one_and_nothing_else(tmp_path: Path) -> None:
    path = tmp_path / "result"
    write_file(path, "old")
    with suppress(ZeroDivisionError), new_file(path) as file:
        file.write(b"half")
        raise ZeroDivisionError
    assert [(one.name, one.read_text()) for one in tmp_path.iterdir()] == [("result", "old")]
    with pytest.raises(LogError, match=r"cannot be written: No such file"):
        write_file(tmp_path / "missing" / "result", "text")


def test_what_is_written_has_the_permissions_of_any_new_file(tmp_path: Path) -> None:
    usual = tmp_path / "usual"
    usual.touch()
    write_file(tmp_path / "result", "text")
    assert (tmp_path / "result").stat().st_mode == usual.stat().st_mode


def test_results_are_written_in_one_place_only() -> None:
    """What writes otherwise does so into folders that TAMS has just made, or that are its own."""
    own = {
        "hw/openvr/bindings.py",  # of the running session
        "tams_app/faces/window/toolkit.py",  # the user's own settings
    }
    writes = re.compile(
        r"\.(write_text|write_bytes|to_csv|savefig|to_parquet)\((?!file\b|buffer\b)"
    )
    root = DEFAULT_CONFIG.parents[1]
    found = {
        str(path.relative_to(root))
        for package in ("tams_app", "hw", "calibration")
        for path in (root / package).rglob("*.py")
        if writes.search(path.read_text(encoding="utf-8"))
    }
    assert found == own
