"""The wizard from a recorded session to a file that the configuration then uses."""

import shutil

import pytest
from typer.testing import CliRunner

from calibration.options import WeightOptions
from calibration.weights.clips import ClipFolder
from calibration.weights.cutting import cut_session, open_session
from calibration.weights.ratings import PAPER_DOMINANT, RatingFolder, simulate_panel
from calibration.weights.report import evidence_remarks
from calibration.weights.wizard import WeightWizard
from tams_app.cli import app
from tams_app.config import load_config
from tams_app.errors import ConfigError, TamsError
from tams_app.records import Phase
from tests.calibration.lab import in_force
from tests.calibration.weights_session import record_session
from tests.scripted_ui import CTRL_C, ScriptedUI

pytestmark = pytest.mark.untimed

VIEWS = ("eih", "gt", "gs")
PNG = b"\x89PNG"


@pytest.fixture(scope="module")
def session(tmp_path_factory):
    """All phases but RELEASE, each long enough for a clip."""
    phases = [(0.6 * number, phase) for number, phase in enumerate(list(Phase)[:-1])]
    return record_session(tmp_path_factory.mktemp("logs") / "trial-1", phases, 3.05)


@pytest.fixture(scope="module")
def clips(session, tmp_path_factory):
    """A folder in which its clips are cut already."""
    folder = tmp_path_factory.mktemp("clips")
    cut_session(open_session(session, VIEWS), ClipFolder(folder / "clips"), lambda *_: None)
    return folder


@pytest.fixture
def calibrate(config_path, clips, tmp_path):
    """Runs the wizard in the folder `work`: its exit code and what it said."""

    def run(answers=(), **options):
        ui = ScriptedUI([*answers])
        options = {"config": config_path, "folder": tmp_path / "work"} | options
        if options.get("logs") and not options["folder"].exists():
            shutil.copytree(clips, options["folder"])
        return WeightWizard(ui, WeightOptions(**options)).run(), "\n".join(ui.said)

    return run


@pytest.fixture
def rated(tmp_path):
    """Makes the files of so many raters: p1 rated so many phases, each other one fewer."""

    def make(raters, phases=6):
        folder = RatingFolder(tmp_path / "ratings", VIEWS)
        for number, sheet in enumerate(simulate_panel(VIEWS, 0, raters)):
            folder.open(f"p{number + 1}")
            for answer in sheet.answers[: phases - number]:
                folder.add(f"p{number + 1}", answer)
        return folder.path

    return make


def test_simulated_raters_make_a_file_that_the_configuration_uses_and_that_says_so(
    config_path, session, tmp_path
):
    before = load_config(config_path).policy.weights.matrix
    arguments = ["calibrate", "weights", "--config", str(config_path), "--sim", "--yes"]
    arguments += ["--from", str(session), "--folder", str(tmp_path / "work")]
    arguments += ["--seed", "1"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    matrix = load_config(config_path).policy.weights.matrix
    for phase in list(Phase)[:-1]:
        assert max(matrix[phase], key=lambda view: matrix[phase][view]) == PAPER_DOMINANT[phase]
    assert matrix[Phase.RELEASE] == before[Phase.RELEASE]
    file, content = in_force(config_path)
    assert list(content["config"]) == ["policy"]
    assert list(content["config"]["policy"]) == ["weights"]
    assert "not of people" in content["calibration"]["source"]
    quality = content["calibration"]["quality"]
    assert quality["simulated_raters"] == 8
    assert "RELEASE: keeps its present row: no rater rated it" in quality["remarks"]
    assert list(quality["clips"]) == ["trial-1"]
    assert file.with_suffix(".png").read_bytes().startswith(PNG)
    assert "5 clips" in result.output
    assert "No clip of RELEASE" in result.output


def test_independent_raters_are_reported_as_disagreeing_in_the_result_and_in_the_file(
    config_path, session, calibrate, monkeypatch
):
    monkeypatch.setattr("calibration.weights.ratings._PREFERRED", 3.0)  # as every other view
    options = {"sim": True, "logs": [session], "yes": True}
    with pytest.raises(TamsError, match=r"agree too little on the most critical view"):
        calibrate(**options)
    assert load_config(config_path).calibrated_by == ()
    with pytest.raises(ConfigError, match="holds ratings of others: give another --folder"):
        calibrate(**options, seed=1)
    code, said = calibrate(**options, accept_unfounded=True)  # the same one goes on
    assert code == 0
    assert "not reliable" in said
    calibration = in_force(config_path)[1]["calibration"]
    assert "agree too little" in calibration["unfounded"]
    assert calibration["quality"]["most_critical_alpha_nominal"] < 0.667


def test_ratings_in_files_make_the_weights_without_asking_anybody_once_yes_is_said(
    config_path, calibrate, rated
):
    ratings = rated(3)
    assert calibrate(ratings=ratings, folder=None)[0] == 1
    assert not (config_path.parent / "calibration").exists()
    assert calibrate(ratings=ratings, folder=None, yes=True, accept_unfounded=True)[0] == 0
    calibration = in_force(config_path)[1]["calibration"]
    assert calibration["source"] == "ratings of 3 people, on unknown clips"
    assert "few raters: 3, where the paper asked 8" in calibration["quality"]["remarks"]
    assert "p3 has rated 4 of 6 phases" in calibration["quality"]["remarks"]


@pytest.fixture
def no_display(monkeypatch):
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)


@pytest.mark.usefixtures("no_display")
def test_a_person_rates_sees_the_result_and_may_refuse_it(
    config_path, session, tmp_path, calibrate
):
    five = ["r", "5", "3", "2", "eih", "y"] * 5
    answers = ["r", "Jane Doe", "r", "p01", *five, "b", "n", "unused"]
    code, said = calibrate(answers, logs=[session])
    assert code == 0
    assert "'Jane Doe' cannot be a rater's name" in said
    assert "There is no display here" in said
    assert str(tmp_path / "work/clips/REACH-trial-1.mp4") in said
    assert "few raters: 1" in said
    assert "RELEASE: keeps its present row" in said
    assert not (config_path.parent / "calibration").exists()
    # what was rated is kept: the next time it is built at once
    assert calibrate(["b", "y", "unused"], logs=[session])[0] == 0
    assert load_config(config_path).policy.weights.matrix[Phase.REACH]["eih"] == 0.60


@pytest.mark.usefixtures("no_display")
def test_ctrl_c_keeps_what_was_rated_and_says_where(config_path, session, clips, tmp_path):
    shutil.copytree(clips, tmp_path / "work")
    ui = ScriptedUI(["r", "p01", "r", "5", "3", "2", "eih", "y", "r", "4", CTRL_C, "unused"])
    with pytest.raises(KeyboardInterrupt):
        WeightWizard(
            ui, WeightOptions(config=config_path, logs=[session], folder=tmp_path / "work")
        ).run()
    assert f"kept in {tmp_path / 'work'}" in ui.said[-1]
    (sheet,) = RatingFolder(tmp_path / "work/ratings", VIEWS).sheets()
    assert len(sheet.answers) == 1


def test_stopping_keeps_everything_and_building_is_not_offered_before_anybody_has_answered(
    config_path, session, clips, tmp_path, calibrate
):
    shutil.copytree(clips, tmp_path / "work")
    RatingFolder(tmp_path / "work/ratings", VIEWS).open("p01")  # and left again
    code, said = calibrate(["b", "s", "unused"], logs=[session])
    assert code == 0
    assert "select one of the available options" in said
    assert "There is no clip of RELEASE: W keeps its present row there." in said
    assert len(list((tmp_path / "work/clips").glob("*.mp4"))) == 5
    assert not (config_path.parent / "calibration").exists()
    with pytest.raises(ConfigError, match="holds ratings of others: give another --folder"):
        calibrate(sim=True, logs=[session], yes=True)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({}, "--from LOG"),
        ({"ratings": "none"}, "is no folder of rating files"),
        ({"ratings": "empty"}, "holds no ratings yet"),
        ({"ratings": "empty", "sim": True}, "leave out --sim"),
    ],
)
def test_what_cannot_be_done_is_refused_with_what_to_do(tmp_path, calibrate, changes, reason):
    (tmp_path / "empty").mkdir()
    if "ratings" in changes:
        changes = changes | {"ratings": tmp_path / changes["ratings"]}
    with pytest.raises(ConfigError, match=reason):
        calibrate(**changes)


def test_a_folder_that_cannot_be_written_is_one_sentence(tmp_path, calibrate, rated):
    (tmp_path / "work").write_text("in the way")
    with pytest.raises(TamsError, match=r"work: cannot be written"):
        calibrate(ratings=rated(1, phases=1), yes=True)


def test_peoples_ratings_of_the_rigs_figures_are_told_where_a_real_arm_is_meant(clips):
    sessions = ClipFolder(clips / "clips").there()
    remark = "the clips of trial-1 show the simulated rig, not a real arm"
    assert evidence_remarks([], sessions, for_rig=False) == [remark]
    assert evidence_remarks([], sessions, for_rig=True) == []
