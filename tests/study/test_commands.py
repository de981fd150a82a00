"""The study's commands as a person meets them."""

from __future__ import annotations

import io
from pathlib import Path

import pytest
from rich.console import Console

import tams_app.study.commands as commands
from tams_app.errors import ConfigError, SetupError
from tams_app.questions import TerminalQuestions
from tams_app.recording.mcap_log import McapLog
from tams_app.records import PacketRecord
from tams_app.study.commands import (
    forget_participant,
    measured_time_s,
    plan_study,
    report_study,
    run_guided,
    run_simulated,
    show_study,
    void_trial,
)
from tams_app.study.folder import StudyFolder
from tams_app.study.report.blocks import Picture
from tams_app.study.report.tracking_section import tracking_section
from tams_app.study.results import read_results
from tests.scripted_ui import ScriptedConsole
from tests.study.synthetic_study import PlantedRunner, fill_study, make_study, small_config
from tests.study.test_guided import HARDWARE, SUCCESS
from tests.study.test_unattended import SMALL
from tests.synthetic_session import START_NS, header, live_records

pytestmark = pytest.mark.untimed


class Screen(Console):
    def __init__(self) -> None:
        self.output = io.StringIO()
        super().__init__(file=self.output, width=250)

    @property
    def text(self) -> str:
        return self.output.getvalue()


def write_log(path: Path) -> None:
    """A log of two seconds without its packets."""
    log = McapLog(path, header())
    for record in live_records(2.0, video_bytes=100):
        if not isinstance(record, PacketRecord):
            log.write(record, START_NS)
    log.close()


def test_planning_says_what_was_planned_and_whether_it_is_balanced(tmp_path: Path) -> None:
    screen = Screen()
    assert plan_study(small_config(), tmp_path / "s", 2, screen) == 0
    assert "18 trials" in screen.text
    assert "Not counterbalanced" in screen.text
    assert StudyFolder(tmp_path / "s").load().participants[1].id == "P02"


def test_showing_tells_who_is_how_far(tmp_path: Path) -> None:
    study = make_study(tmp_path, 2, **SMALL)
    fill_study(study, PlantedRunner(), leave=("P02-03",))
    screen = Screen()
    assert void_trial(tmp_path, "P01-02", "the light went out", screen) == 0
    show_study(tmp_path, screen)
    rows = [line.split("│")[1:-1] for line in screen.text.splitlines() if "│ P0" in line]
    assert [[cell.strip() for cell in row] for row in rows] == [
        ["P01", "3", "1", "1", "P01-02"],
        ["P02", "3", "1", "0", "P02-03"],
    ]


def test_forgetting_says_what_is_gone_and_what_remains(tmp_path: Path) -> None:
    study = make_study(tmp_path, 2, **SMALL)
    fill_study(study, PlantedRunner())
    screen = Screen()
    assert forget_participant(tmp_path, "P02", screen) == 0
    assert "P02 is forgotten: 4 trials" in screen.text
    assert "4 finished trials of the others" in screen.text
    show_study(tmp_path, screen)
    assert "forgotten" in screen.text
    data = read_results(study)
    assert {result.participant for result in data.results} == {"P01"}


def test_commands_on_no_study_leave_nothing_behind(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="make one with `study plan`"):
        void_trial(tmp_path / "none", "P01-01", "why", Screen())
    with pytest.raises(ConfigError, match="make one with `study plan`"):
        forget_participant(tmp_path / "none", "P01", Screen())
    assert not (tmp_path / "none").exists()


def test_simulated_and_human_studies_are_not_run_the_other_way(tmp_path: Path) -> None:
    simulated = make_study(tmp_path / "sim", 1)
    with pytest.raises(ConfigError, match="add --sim"):
        run_guided(simulated, PlantedRunner(), None, TerminalQuestions(Screen()))
    human = make_study(tmp_path / "human", 1, **HARDWARE)
    with pytest.raises(ConfigError, match="leave out --sim"):
        run_simulated(human, PlantedRunner(), Screen())


def test_a_sitting_through_the_command(tmp_path: Path) -> None:
    study = make_study(tmp_path, 1, **HARDWARE)
    person = ScriptedConsole("g", "j", "y", "0", "44", "y", "s")
    runner = PlantedRunner(judged=False)
    assert run_guided(study, runner, "P01", TerminalQuestions(person)) == 0
    (result,) = read_results(study).results
    assert (result.success, result.completion_time_s) == (True, 44.0)
    assert len(SUCCESS) < 7  # without a log the time is asked for


def test_the_time_is_measured_from_the_log_where_there_is_one(tmp_path: Path) -> None:
    assert measured_time_s(tmp_path) is None
    write_log(tmp_path / "session.mcap")
    assert measured_time_s(tmp_path) is None  # nobody engaged in that session


def test_the_tracking_example_is_drawn_from_a_fitting_trial_s_log(tmp_path: Path) -> None:
    study = make_study(tmp_path, 1, **SMALL)
    fill_study(study, PlantedRunner())
    for trial in study.load().trials:
        write_log(tmp_path / trial.attempts[0].folder / "session.mcap")
    picture = tracking_section(read_results(study)).blocks[0]
    assert isinstance(picture, Picture)
    assert "TAMS on S2" in picture.caption


def test_a_report_without_its_extra_says_how_to_get_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(commands, "find_spec", lambda name: None if name == "pyarrow" else name)
    with pytest.raises(SetupError, match=r"pyarrow missing: pip install 'tams\[study\]'"):
        report_study(tmp_path, Screen())


def test_the_report_command_names_what_it_wrote(tmp_path: Path) -> None:
    for extra in ("pandas", "pyarrow", "statsmodels"):
        pytest.importorskip(extra)
    study = make_study(tmp_path, 1, study__strategies=["equal", "tams"], study__networks=["s1"])
    fill_study(study, PlantedRunner())
    screen = Screen()
    assert report_study(tmp_path, screen) == 0
    for name in ("report.html", "report.pdf", "trials.parquet", "phases.csv"):
        assert name in screen.text
        assert list(tmp_path.rglob(name))
