"""Rating at the terminal and its files: resumable, never overwritten, checked when read."""

import pytest

from calibration.weights import wizard
from calibration.weights.clips import Clip
from calibration.weights.ratings import RatedPhase, RatingFolder
from calibration.weights.wizard import rate, viewing_order
from tams_app.errors import ConfigError, LogError
from tams_app.records import Phase
from tests.scripted_ui import ScriptedUI

pytestmark = pytest.mark.untimed

VIEWS = ("eih", "gt", "gs")
REACH_ANSWER = RatedPhase(
    phase=Phase.REACH, necessity={"eih": 2, "gt": 5, "gs": None}, most_critical="gt"
)
SILENT = RatedPhase(phase=Phase.GRASP, necessity=dict.fromkeys(VIEWS), most_critical=None)


@pytest.fixture
def folder(tmp_path):
    return RatingFolder(tmp_path / "ratings", VIEWS)


def clips(tmp_path, sessions=("a", "b", "c"), phases=tuple(Phase)):
    return [
        Clip(tmp_path / f"{phase.value}-{session}.mp4", phase, 1.0)
        for phase in phases
        for session in sessions
    ]


def test_what_was_answered_reads_back_and_is_only_ever_added_to(folder):
    assert folder.open("p01").answers == ()
    folder.add("p01", REACH_ANSWER)
    before = (folder.path / "p01.yaml").read_bytes()
    folder.add("p01", SILENT)
    (sheet,) = folder.sheets()
    assert sheet == folder.open("p01")
    assert sheet.answers == (REACH_ANSWER, SILENT)
    assert not sheet.simulated
    assert (folder.path / "p01.yaml").read_bytes().startswith(before)
    with pytest.raises(ConfigError, match="REACH is answered already"):
        folder.add("p01", SILENT.model_copy(update={"phase": Phase.REACH}))
    assert folder.open("p01").answers == sheet.answers


@pytest.mark.parametrize("name", ["", "../p01", "Jane Doe", "p/1", "p01.yaml", "x" * 41])
def test_a_name_that_is_no_pseudonym_is_refused(folder, name):
    with pytest.raises(ConfigError, match="cannot be a rater's name"):
        folder.open(name)
    assert not folder.path.exists()


@pytest.mark.parametrize("name", ["0123", "yes", "null", "1e3"])
def test_a_pseudonym_that_yaml_would_take_for_something_else_stays_text(folder, name):
    folder.open(name)
    assert [sheet.rater for sheet in folder.sheets()] == [name]


def test_a_simulated_rater_cannot_be_taken_for_a_person(folder):
    folder.open("p01", simulated=True)
    with pytest.raises(ConfigError, match="another kind of rater"):
        folder.open("p01")


@pytest.mark.parametrize(
    ("line", "reason"),
    [
        ("- {phase: REACH, necessity: {eih: 6, gt: 1, gs: 1}, most_critical: gt}", "less than"),
        ("- {phase: REACH, necessity: {eih: 0, gt: 1, gs: 1}, most_critical: gt}", "greater than"),
        ("- {phase: REACH, necessity: {eih: 2.5, gt: 1, gs: 1}, most_critical: gt}", "integer"),
        ("- {phase: REACH, necessity: {eih: 2, gt: 1}, most_critical: gt}", "must name eih, gt"),
        ("- {phase: REACH, necessity: {eih: 2, gt: 1, gs: 1}, most_critical: up}", "must be one"),
        ("- {phase: NAP, necessity: {eih: 2, gt: 1, gs: 1}, most_critical: gt}", "phase"),
        ("- {phase: REACH, necessity: {eih: 2, gt: 1, gs: 1}, most_crit", "not valid YAML"),
        (2 * f"- {SILENT.model_dump_json()}\n", "GRASP: is answered twice"),
        ("rater: p02", "rater: is p02; the file must bear that name"),
        ("rater: Jane Doe", "rater: must match"),
    ],
)
def test_a_spoilt_rating_file_is_refused_with_its_name_and_the_reason(folder, line, reason):
    folder.open("p01")
    file = folder.path / "p01.yaml"
    text = file.read_text().replace("answers: []", "answers:").replace("rater: p01\n", "")
    file.write_text(text + f"{line}\n" + ("" if "rater:" in line else "rater: p01\n"))
    with pytest.raises(ConfigError, match=reason) as refusal:
        folder.sheets()
    assert "p01.yaml" in str(refusal.value)


@pytest.mark.parametrize("answers", ["answers: []", "answers:\n  - "])
def test_a_file_written_by_hand_is_added_to_however_it_is_laid_out(folder, answers):
    folder.open("p01")
    file = folder.path / "p01.yaml"
    if answers.endswith("- "):
        answers += "{phase: REACH, necessity: {eih: 1, gt: 1, gs: 1}, most_critical: gt}"
    file.write_text(file.read_text().replace("answers: []", answers).rstrip("\n"))
    before = folder.open("p01").answers
    folder.add("p01", SILENT)
    assert folder.open("p01").answers[:-1] == before


def test_a_disk_that_is_full_while_an_answer_is_added_loses_no_other(folder, monkeypatch):
    folder.open("p01")
    folder.add("p01", REACH_ANSWER)
    before = (folder.path / "p01.yaml").read_bytes()

    def full(_):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr("tams_app.study.folder.os.fsync", full)
    with pytest.raises(LogError, match="No space left"):
        folder.add("p01", SILENT)
    assert (folder.path / "p01.yaml").read_bytes() == before


def test_every_rater_sees_every_clip_once_in_an_order_of_its_own(tmp_path):
    given_ = clips(tmp_path)
    orders = [viewing_order(given_, rater, 1) for rater in ("p01", "p02", "p03")]
    for order in orders:
        assert sorted(phase.value for phase, _ in order) == sorted(phase.value for phase in Phase)
        for phase, shown in order:
            assert {clip.path for clip in shown} == {c.path for c in given_ if c.phase is phase}
            assert len(shown) == 3
    assert len({tuple(phase for phase, _ in order) for order in orders}) > 1
    assert viewing_order(given_, "p01", 1) == orders[0]
    assert viewing_order(given_, "p01", 2) != orders[0]


def test_a_rater_watches_then_answers_and_what_they_stand_by_is_kept(tmp_path, folder, monkeypatch):
    watched = []
    monkeypatch.setattr(wizard, "play", watched.append)
    taken_back = ["1", "1", "1", "eih", "n"]
    ui = ScriptedUI(["w", "r", *taken_back, "2", "5", "-", "gt", "y"])
    given_ = clips(tmp_path, ("a", "b"), (Phase.REACH,))
    rate(ui, folder, "p01", given_, VIEWS, True, seed=0)
    assert len(watched) == 4  # two clips, watched again
    assert set(watched) == {clip.path for clip in given_}
    assert folder.open("p01").answers == (REACH_ANSWER,)


def test_an_interrupted_rater_goes_on_where_it_stopped(tmp_path, folder):
    given_ = clips(tmp_path, ("a",))
    one = ["r", "3", "3", "3", "gt", "y"]
    with pytest.raises(ConfigError, match="no terminal"):
        rate(ScriptedUI(one * 2 + ["r", "4"]), folder, "p01", given_, VIEWS, False, seed=0)
    first = folder.open("p01").answers
    assert len(first) == 2
    ui = ScriptedUI(one * 4)
    rate(ui, folder, "p01", given_, VIEWS, False, seed=0)
    assert any("has rated 2 phases before" in text for text in ui.said)
    answers = folder.open("p01").answers
    assert answers[:2] == first
    assert {answer.phase for answer in answers} == set(Phase)
    again = ScriptedUI()
    rate(again, folder, "p01", given_, VIEWS, False, seed=0)
    assert again.said == ["p01 has rated every phase. Thank you. The ratings stay as they are."]
