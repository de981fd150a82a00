"""The wizard from a recorded session to a file that the configuration then uses."""

import shutil
from dataclasses import replace

import pytest
import yaml
from typer.testing import CliRunner

from calibration.options import WeightOptions
from calibration.ui import WizardUI
from calibration.weights.clips import ClipFolder
from calibration.weights.cutting import cut_session
from calibration.weights.fit import assess
from calibration.weights.panel import PAPER_DOMINANT, simulate_panel
from calibration.weights.ratings import RatingFolder
from calibration.weights.report import evidence_remarks, save_weights
from calibration.weights.sources import open_session
from calibration.weights.wizard import WeightWizard
from tams_app.cli import app
from tams_app.config import CONFIG_DIRECTORY, load_config
from tams_app.errors import ConfigError, TamsError
from tams_app.records import Phase
from tests.calibration.weights_session import record_session
from tests.scripted_ui import CTRL_C, ScriptedUI

pytestmark = pytest.mark.untimed

VIEWS = ("eih", "gt", "gs")
PNG = b"\x89PNG"


@pytest.fixture
def config(tmp_path):
    """A copy of the configuration, so that the real one stays as it is."""
    folder = tmp_path / "config"
    folder.mkdir()
    for file in CONFIG_DIRECTORY.glob("*.yaml"):
        shutil.copy(file, folder)
    return folder / "tams.yaml"


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """All phases but RELEASE, each long enough for a clip."""
    phases = [(0.6 * number, phase) for number, phase in enumerate(list(Phase)[:-1])]
    return record_session(tmp_path_factory.mktemp("logs") / "trial-1", phases, 3.05)


def written(config):
    index = yaml.safe_load((config.parent / "calibration/rig/in-force.yaml").read_text())
    return config.parent / "calibration/rig" / index["weights"]


def test_simulated_raters_make_a_file_that_the_configuration_uses_and_that_says_so(
    config, session, tmp_path
):
    options = WeightOptions(
        config=config, sim=True, logs=[session], folder=tmp_path / "work", seed=1, yes=True
    )
    ui = ScriptedUI()
    before = load_config(config).policy.weights.matrix
    assert WeightWizard(ui, options).run() == 0
    matrix = load_config(config).policy.weights.matrix
    for phase in list(Phase)[:-1]:
        assert max(matrix[phase], key=lambda view: matrix[phase][view]) == PAPER_DOMINANT[phase]
    assert matrix[Phase.RELEASE] == before[Phase.RELEASE]
    content = yaml.safe_load(written(config).read_text())
    assert list(content["config"]) == ["policy"]
    assert list(content["config"]["policy"]) == ["weights"]
    assert "not of people" in content["calibration"]["source"]
    quality = content["calibration"]["quality"]
    assert quality["simulated_raters"] == 8
    assert "RELEASE: keeps its present row: no rater rated it" in quality["remarks"]
    assert list(quality["clips"]) == ["trial-1"]
    assert written(config).with_suffix(".png").read_bytes().startswith(PNG)
    assert any("5 clips" in text and "No clip of RELEASE" in text for text in ui.said)


def test_independent_raters_are_reported_as_disagreeing_in_the_result_and_in_the_file(
    config, session, tmp_path
):
    options = WeightOptions(
        config=config,
        sim=True,
        logs=[session],
        folder=tmp_path / "work",
        panel="indifferent",
        yes=True,
    )
    ui = ScriptedUI()
    with pytest.raises(TamsError, match=r"agree too little on the most critical view"):
        WeightWizard(ui, options).run()
    assert not (config.parent / "calibration/rig/in-force.yaml").exists()
    assert WeightWizard(ui, replace(options, accept_unfounded=True)).run() == 0
    assert "too little to rely on" in "".join(ui.said)
    content = yaml.safe_load(written(config).read_text())
    assert "agree too little" in content["calibration"]["unfounded"]
    remarks = content["calibration"]["quality"]["remarks"]
    assert sum("too little to rely on" in remark for remark in remarks) == 2
    assert content["calibration"]["quality"]["most_critical_alpha_nominal"] < 0.667


def test_ratings_in_files_make_the_weights_without_asking_anybody(config, tmp_path):
    folder = RatingFolder(tmp_path / "ratings", VIEWS)
    for sheet in simulate_panel("paper", VIEWS, Phase, 3, 0):
        folder.open(sheet.rater.replace("simulated", "p"))
        for answer in sheet.answers:
            folder.add(sheet.rater.replace("simulated", "p"), answer)
    options = WeightOptions(config=config, ratings=folder.path, yes=True, accept_unfounded=True)
    assert WeightWizard(ScriptedUI(), options).run() == 0
    calibration = yaml.safe_load(written(config).read_text())["calibration"]
    assert calibration["source"] == "ratings of 3 people, on unknown clips"
    assert "few raters: 3, where the paper asked 8" in calibration["quality"]["remarks"]


def test_without_anybody_to_ask_and_without_yes_nothing_is_written(config, tmp_path):
    folder = RatingFolder(tmp_path / "ratings", VIEWS)
    folder.open("p01")
    folder.add("p01", simulate_panel("paper", VIEWS, Phase, 1, 0)[0].answers[0])
    assert WeightWizard(ScriptedUI(), WeightOptions(config=config, ratings=folder.path)).run() == 1
    assert not (config.parent / "calibration").exists()


def test_a_person_rates_sees_the_result_and_may_refuse_it(config, session, tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    rated = ["r", "5", "3", "2", "eih", "y"] * 5
    options = WeightOptions(config=config, logs=[session], folder=tmp_path / "work")
    ui = ScriptedUI(["r", "Jane Doe", "r", "p01", *rated, "b", "n", "unused"])
    assert WeightWizard(ui, options).run() == 0
    said = "\n".join(ui.said)
    assert "'Jane Doe' cannot be a rater's name" in said
    assert "There is no display here" in said
    assert str(tmp_path / "work/clips/REACH-trial-1.mp4") in said
    assert "few raters: 1" in said
    assert "RELEASE: keeps its present row" in said
    assert not (config.parent / "calibration").exists()
    # what was rated is kept: the next time it is built at once
    assert WeightWizard(ScriptedUI(["b", "y", "unused"]), options).run() == 0
    assert load_config(config).policy.weights.matrix[Phase.REACH]["eih"] == 0.60


def test_ctrl_c_keeps_what_was_rated_and_says_where(config, session, tmp_path, monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    ui = ScriptedUI(["r", "p01", "r", "5", "3", "2", "eih", "y", "r", "4", CTRL_C, "unused"])
    with pytest.raises(KeyboardInterrupt):
        WeightWizard(
            ui, WeightOptions(config=config, logs=[session], folder=tmp_path / "work")
        ).run()
    assert f"kept in {tmp_path / 'work'}" in ui.said[-1]
    (sheet,) = RatingFolder(tmp_path / "work/ratings", VIEWS).sheets()
    assert len(sheet.answers) == 1


def test_building_is_not_offered_before_anybody_has_answered(config, session, tmp_path):
    options = WeightOptions(config=config, logs=[session], folder=tmp_path / "work")
    ui = ScriptedUI(["b", "s", "unused"])
    RatingFolder(tmp_path / "work/ratings", VIEWS).open("p01")  # and left again
    assert WeightWizard(ui, options).run() == 0
    assert any("select one of the available options" in text for text in ui.said)
    assert "There is no clip of RELEASE: W keeps its present row there." in ui.said


def test_stopping_keeps_everything_and_writes_nothing(config, session, tmp_path):
    options = WeightOptions(config=config, logs=[session], folder=tmp_path / "work")
    assert WeightWizard(ScriptedUI(["s"]), options).run() == 0
    assert len(list((tmp_path / "work/clips").glob("*.mp4"))) == 5
    assert not (config.parent / "calibration").exists()


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({}, "--from LOG"),
        ({"ratings": "none"}, "is no folder of rating files"),
        ({"ratings": "empty"}, "holds no ratings yet"),
        ({"ratings": "empty", "sim": True}, "leave out --sim"),
        ({"panel": "nice", "sim": True}, "'nice' is not one of paper, indifferent"),
    ],
)
def test_what_cannot_be_done_is_refused_with_what_to_do(config, tmp_path, changes, reason):
    (tmp_path / "empty").mkdir()
    if "ratings" in changes:
        changes = changes | {"ratings": tmp_path / changes["ratings"]}
    with pytest.raises(ConfigError, match=reason):
        WeightWizard(
            ScriptedUI(), WeightOptions(config=config, folder=tmp_path / "work", **changes)
        ).run()


def test_simulated_ratings_are_not_put_beside_those_of_people(config, session, tmp_path):
    folder = RatingFolder(tmp_path / "work/ratings", VIEWS)
    folder.open("p01")
    options = WeightOptions(
        config=config, sim=True, logs=[session], folder=tmp_path / "work", yes=True
    )
    with pytest.raises(ConfigError, match="holds ratings of people: give another --folder"):
        WeightWizard(ScriptedUI(), options).run()


@pytest.mark.verify
@pytest.mark.parametrize("changes", [{"panel": "indifferent"}, {"seed": 2}])
def test_ratings_of_one_simulated_panel_are_not_called_those_of_another(
    config, session, tmp_path, changes
):
    options = WeightOptions(
        config=config, sim=True, logs=[session], folder=tmp_path / "work", seed=1, yes=True
    )
    assert WeightWizard(ScriptedUI(), options).run() == 0
    assert WeightWizard(ScriptedUI(), options).run() == 0  # the same one goes on
    with pytest.raises(ConfigError, match="ratings of another simulated panel"):
        WeightWizard(ScriptedUI(), replace(options, **changes)).run()


def test_peoples_ratings_of_the_rigs_figures_are_told_where_a_real_arm_is_meant(
    config, session, tmp_path
):
    cut_session(open_session(session, VIEWS), ClipFolder(tmp_path / "clips"), lambda *_: None)
    sessions = ClipFolder(tmp_path / "clips").there()
    remark = "the clips of trial-1 show the simulated rig, not a real arm"
    assert evidence_remarks([], sessions, for_rig=False) == [remark]
    assert evidence_remarks([], sessions, for_rig=True) == []


def test_a_folder_that_cannot_be_written_is_one_sentence(config, tmp_path):
    folder = RatingFolder(tmp_path / "ratings", VIEWS)
    folder.open("p01")
    folder.add("p01", simulate_panel("paper", VIEWS, Phase, 1, 0)[0].answers[0])
    (tmp_path / "work").write_text("in the way")
    options = WeightOptions(config=config, ratings=folder.path, folder=tmp_path / "work", yes=True)
    with pytest.raises(TamsError, match=r"work: cannot be written"):
        WeightWizard(ScriptedUI(), options).run()


def test_a_rater_who_left_phases_out_is_named(config, tmp_path):
    folder = RatingFolder(tmp_path / "ratings", VIEWS)
    for sheet in simulate_panel("paper", VIEWS, Phase, 2, 0):
        folder.open(sheet.rater, simulated=True)
        for answer in sheet.answers[: 6 if sheet.rater.endswith("1") else 2]:
            folder.add(sheet.rater, answer)
    ui = ScriptedUI()
    WeightWizard(ui, WeightOptions(config=config, ratings=folder.path)).run()
    assert "simulated-02 has rated 2 of 6 phases" in "".join(ui.said)


def test_a_path_is_said_as_it_is_whatever_it_looks_like(capsys):
    WizardUI().print("Please watch /tmp/[red]a/:smile:.mp4")
    assert capsys.readouterr().out == "Please watch /tmp/[red]a/:smile:.mp4\n"


def test_the_same_ratings_give_the_same_figure(tmp_path):
    present = load_config().policy.weights.matrix
    sheets = simulate_panel("paper", VIEWS, list(Phase)[:4], 5, 0)
    for name in ("one.png", "two.png"):
        save_weights(assess(sheets, VIEWS, present), sheets, VIEWS, tmp_path / name)
    assert (tmp_path / "one.png").read_bytes() == (tmp_path / "two.png").read_bytes()
    assert (tmp_path / "one.png").stat().st_size < 150_000


def test_the_command_line_takes_its_options_to_the_wizard(config, session, tmp_path):
    arguments = ["calibrate", "weights", "--config", str(config), "--sim", "--from", str(session)]
    arguments += ["--folder", str(tmp_path / "work"), "--seed", "1", "--panel", "paper", "--yes"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert written(config).is_file()
