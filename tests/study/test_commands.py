"""The study's commands as a person meets them."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from tams_app.cli import _main
from tams_app.errors import SetupError
from tams_app.study.commands import (
    forget_participant,
    report_study,
    run_guided,
    void_trial,
)
from tests.scripted_ui import ScriptedConsole
from tests.study.synthetic_study import PlantedRunner, fill_study, make_study
from tests.study.test_guided import HARDWARE
from tests.study.test_unattended import SMALL
from tests.study.test_verdict import log_in

pytestmark = pytest.mark.untimed


def test_a_program_reads_who_is_how_far(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    study = make_study(tmp_path, 2, **SMALL)
    fill_study(study, PlantedRunner(), leave=("P02-03",))
    assert void_trial(tmp_path, "P02-02", "the light went out", ScriptedConsole()) == 0
    forget_participant(tmp_path, "P01", ScriptedConsole(), yes=True)
    assert _main(["study", "show", str(tmp_path), "--json"]) == 0
    tree = json.loads(capsys.readouterr().out)
    assert (tree["trials"], tree["simulated"]) == (4, True)
    assert "Not counterbalanced" in tree["balance"]
    gone, here = tree["participants"]
    assert (gone["participant"], gone["state"], gone["done"]) == ("P01", "forgotten", None)
    assert here == {
        "participant": "P02",
        "state": "takes part",
        "done": 2,
        "planned": 2,
        "void_or_failed": 1,
        "next": "P02-02",
    }


@pytest.mark.parametrize(("answer", "code"), [("n", 1), ("y", 0)])
def test_forgetting_asks_first(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, answer: str, code: int
) -> None:
    study = make_study(tmp_path, 2, **SMALL)
    fill_study(study, PlantedRunner())
    monkeypatch.setattr("sys.stdin.isatty", lambda: True, raising=False)
    screen = ScriptedConsole(answer)
    assert forget_participant(tmp_path, "P02", screen, yes=False) == code
    assert "Delete P02" in screen.asked[0]
    assert (tmp_path / "trials/P02").exists() == bool(code)


def test_a_sitting_that_ends_at_a_trial_that_could_not_be_run_has_failed(tmp_path: Path) -> None:
    study = make_study(tmp_path, 1, **HARDWARE)
    runner = PlantedRunner(judged=False, fails=("P01-01",))
    assert run_guided(study, runner, "P01", ScriptedConsole("g", "s")) == 1
    assert run_guided(study, runner, "P01", ScriptedConsole("g", "a", "s")) == 0


def test_the_tracking_example_is_drawn_from_a_fitting_trial_s_log(
    tmp_path: Path, undrawn: None
) -> None:
    from tams_app.study.report.build import build_report
    from tams_app.study.results import read_results

    study = make_study(tmp_path, 1, **SMALL)
    fill_study(study, PlantedRunner())
    for trial in study.load().trials:
        log_in(tmp_path / trial.attempts[0].folder)
    report = build_report(read_results(study))
    assert "rate of each view, TAMS on S2 (P01-0" in report.html
    assert report.figures["tracking"] == b"drawn"


def test_a_report_without_its_extra_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(
        "tams_app.errors.find_spec", lambda name: None if name == "pyarrow" else name
    )
    with pytest.raises(SetupError, match=r"^study report needs pyarrow: make extras$"):
        report_study(tmp_path, ScriptedConsole())
