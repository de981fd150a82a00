"""The study's commands as a person meets them."""

from __future__ import annotations

import io
import json
from pathlib import Path
from unittest.mock import MagicMock

import pytest

import tams_app.study.commands as commands
from tams_app.cli import _main
from tams_app.errors import ConfigError, SetupError
from tams_app.study.commands import (
    forget_participant,
    plan_study,
    report_study,
    run_guided,
    run_simulated,
    show_study,
    void_trial,
)
from tams_app.study.folder import StudyFolder
from tams_app.study.plan import Verdict
from tests.study.experimenter import Experimenter
from tests.study.synthetic_study import PlantedRunner, fill_study, make_study, small_config
from tests.study.test_guided import HARDWARE
from tests.study.test_unattended import SMALL
from tests.study.test_verdict import write_log

pytestmark = pytest.mark.untimed


def test_planning_says_what_was_planned_and_whether_it_is_balanced(tmp_path: Path) -> None:
    screen = Experimenter()
    assert plan_study(small_config(), tmp_path / "s", 2, screen) == 0
    assert "18 trials" in screen.text
    assert "Not counterbalanced" in screen.text
    assert StudyFolder(tmp_path / "s").load().participants[1].id == "P02"


def test_showing_tells_who_is_how_far(tmp_path: Path) -> None:
    study = make_study(tmp_path, 2, **SMALL)
    fill_study(study, PlantedRunner(), leave=("P02-03",))
    screen = Experimenter()
    assert void_trial(tmp_path, "P01-02", "the light went out", screen) == 0
    show_study(tmp_path, screen)
    rows = [line.split("│")[1:-1] for line in screen.text.splitlines() if "│ P0" in line]
    assert [[cell.strip() for cell in row] for row in rows] == [
        ["P01", "3", "1", "1", "P01-02"],
        ["P02", "3", "1", "0", "P02-03"],
    ]


def test_a_program_reads_who_is_how_far(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = make_study(tmp_path, 2, **SMALL)
    fill_study(study, PlantedRunner(), leave=("P02-03",))
    forget_participant(tmp_path, "P01", Experimenter(), yes=True)
    assert _main(["study", "show", str(tmp_path), "--json"]) == 0
    tree = json.loads(capsys.readouterr().out)
    assert (tree["trials"], tree["simulated"]) == (4, True)
    assert "Not counterbalanced" in tree["balance"]
    gone, here = tree["participants"]
    assert (gone["participant"], gone["state"], gone["done"]) == ("P01", "forgotten", None)
    assert here == {
        "participant": "P02",
        "state": "takes part",
        "done": 3,
        "planned": 1,
        "void_or_failed": 0,
        "next": "P02-03",
    }


def test_forgetting_says_what_is_gone_and_what_remains(tmp_path: Path) -> None:
    study = make_study(tmp_path, 2, **SMALL)
    fill_study(study, PlantedRunner())
    screen = Experimenter()
    assert forget_participant(tmp_path, "P02", screen, yes=True) == 0
    assert "P02 is forgotten: 4 trials" in screen.text
    assert "4 finished trials of the others" in screen.text
    show_study(tmp_path, screen)
    assert "forgotten" in screen.text
    assert {trial.participant for trial in study.load().trials} == {"P01"}


@pytest.mark.parametrize(("answer", "code"), [("n", 1), ("y", 0)])
def test_forgetting_asks_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answer: str, code: int
) -> None:
    study = make_study(tmp_path, 2, **SMALL)
    fill_study(study, PlantedRunner())
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    screen = Experimenter(answer)
    assert forget_participant(tmp_path, "P02", screen, yes=False) == code
    assert "Delete P02" in screen.asked[0]
    assert (tmp_path / "trials/P02").exists() == bool(code)


def test_without_a_terminal_forgetting_needs_yes(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = make_study(tmp_path, 2, **SMALL)
    fill_study(study, PlantedRunner())
    monkeypatch.setattr("sys.stdin", io.StringIO("y\n"))
    with pytest.raises(ConfigError, match="without a terminal add --yes"):
        forget_participant(tmp_path, "P02", Experimenter(), yes=False)
    assert (tmp_path / "trials/P02").exists()


def test_commands_on_no_study_leave_nothing_behind(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="make one with `study plan`"):
        void_trial(tmp_path / "none", "P01-01", "why", Experimenter())
    with pytest.raises(ConfigError, match="make one with `study plan`"):
        forget_participant(tmp_path / "none", "P01", Experimenter(), yes=True)
    assert not (tmp_path / "none").exists()


def test_simulated_and_human_studies_are_not_run_the_other_way(tmp_path: Path) -> None:
    simulated = make_study(tmp_path / "sim", 1)
    with pytest.raises(ConfigError, match="add --sim"):
        run_guided(simulated, PlantedRunner(), None, Experimenter())
    human = make_study(tmp_path / "human", 1, **HARDWARE)
    with pytest.raises(ConfigError, match="leave out --sim"):
        run_simulated(human, PlantedRunner(), Experimenter())


def test_a_sitting_through_the_command(tmp_path: Path) -> None:
    study = make_study(tmp_path, 1, **HARDWARE)
    person = Experimenter("g", "j", "y", "0", "44", "y", "s")  # without a log the time is asked for
    assert run_guided(study, PlantedRunner(judged=False), "P01", person) == 0
    verdict = study.load().trials[0].attempts[0].verdict
    assert verdict == Verdict(completed=True, success=True, drops=0, completion_time_s=44.0)


def test_a_sitting_that_ends_at_a_trial_that_could_not_be_run_has_failed(tmp_path: Path) -> None:
    study = make_study(tmp_path, 1, **HARDWARE)
    runner = PlantedRunner(judged=False, fails=("P01-01",))
    assert run_guided(study, runner, "P01", Experimenter("g", "s")) == 1
    assert run_guided(study, runner, "P01", Experimenter("g", "a", "s")) == 0


def test_the_tracking_example_is_drawn_from_a_fitting_trial_s_log(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    for extra in ("jinja2", "pandas", "statsmodels"):
        pytest.importorskip(extra)
    from tams_app.study.report import build
    from tams_app.study.results import read_results

    study = make_study(tmp_path, 1, **SMALL)
    fill_study(study, PlantedRunner())
    for trial in study.load().trials:
        write_log(tmp_path / trial.attempts[0].folder / "session.mcap")
    monkeypatch.setattr(build, "drawing", MagicMock())  # the other figures
    monkeypatch.setattr(build, "to_png", lambda figure: b"drawn")
    monkeypatch.setattr(build, "to_svg", lambda figure: "drawn")
    report = build.build_report(read_results(study))
    assert "rate of each view, TAMS on S2 (P01-0" in report.html
    assert report.figures["tracking"] == b"drawn"


def test_a_report_without_its_extra_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(commands, "find_spec", lambda name: None if name == "pyarrow" else name)
    with pytest.raises(SetupError, match=r"pyarrow missing: pip install 'tams\[study\]'"):
        report_study(tmp_path, Experimenter())
