"""Guiding an experimenter: what they are asked, what is kept, and going on after anything."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import pytest

from tams_app.errors import ConfigError
from tams_app.study.folder import StudyFolder
from tams_app.study.guided import GuidedRun, Marks
from tams_app.study.plan import AttemptState, Verdict
from tams_app.study.runner import TrialRunner
from tests.scripted_ui import ScriptedConsole
from tests.study.synthetic_study import PlantedRunner, make_study

pytestmark = pytest.mark.untimed

HARDWARE = {
    "rig__enabled": False,
    "cameras": {view: {"source": "pattern"} for view in ("eih", "gt", "gs")},
    "study__strategies": ["equal", "tams"],
    "study__networks": ["s1"],
}
RUNNER = PlantedRunner(judged=False)


@pytest.fixture(autouse=True)
def _measured(monkeypatch: pytest.MonkeyPatch) -> None:
    """Every log has a completion time."""
    monkeypatch.setattr("tams_app.study.guided.marks_in", lambda folder: Marks(31.5))


def sit(
    study: StudyFolder,
    person: ScriptedConsole,
    runner: TrialRunner = RUNNER,
    participant: str | None = None,
) -> int:
    return GuidedRun(study, runner, person).run(participant)


def hardware_study(path: Path, participants: int = 1, **more: object) -> StudyFolder:
    return make_study(path, participants, **{**HARDWARE, **more})


SUCCESS: Sequence[str] = ("g", "j", "y", "0", "y", "y")  # go, judge, placed, drops, time, correct


def test_a_sitting_goes_through_all_trials_keeps_the_verdicts_and_never_names_the_strategy(
    tmp_path: Path,
) -> None:
    study = hardware_study(tmp_path)
    person = ScriptedConsole(*SUCCESS, "g", "j", "n", "3")
    assert sit(study, person) == 2
    verdicts = [trial.attempts[0].verdict for trial in study.load().trials]
    assert verdicts == [
        Verdict(completed=True, success=True, drops=0, completion_time_s=31.5),
        Verdict(completed=False, success=False, drops=3),
    ]
    assert "has done all trials" in person.said[-1]
    spoken = " ".join([*person.said, *person.asked]).lower()
    assert "tams " not in spoken.replace("run_tams.py", "")
    assert "equal" not in spoken
    marks = {text.split("start mark ")[1][0] for text in person.said if "start mark" in text}
    assert len(marks) == 1  # paired trials begin with the same scene


def test_a_void_trial_is_taken_again_and_its_reason_and_data_stay(tmp_path: Path) -> None:
    study = hardware_study(tmp_path)
    person = ScriptedConsole("g", "v", "", "the light went out", *SUCCESS, *SUCCESS)
    assert sit(study, person) == 2
    trial = study.load().trials[0]
    assert [one.state for one in trial.attempts] == [AttemptState.VOID, AttemptState.DONE]
    assert trial.attempts[0].reason == "the light went out"
    assert (tmp_path / trial.attempts[0].folder / "summary.json").is_file()
    assert any("taken again" in text for text in person.said)
    assert sum("Why is it void?" in question for question in person.asked) == 2


@pytest.mark.parametrize("state", [AttemptState.RAN, AttemptState.STARTED])
def test_leaving_before_the_verdict_or_a_kill_asks_only_for_the_verdict_next_time(
    tmp_path: Path, state: AttemptState
) -> None:
    study = hardware_study(tmp_path)
    assert sit(study, ScriptedConsole("g")) == 0
    plan = study.load()
    attempt = plan.trials[0].last
    assert attempt.state is AttemptState.RAN
    left = attempt.model_copy(update={"state": state})  # started: killed before it was noted
    study.save(plan.with_attempt(plan.trials[0].id, left))
    person = ScriptedConsole("j", "y", "0", "y", "y", "s")
    assert sit(study, person) == 1
    assert "has no verdict" in person.said[0]
    assert len(study.load().trials[0].attempts) == 1


def test_a_trial_that_cannot_be_run_is_retried_on_request(tmp_path: Path) -> None:
    study = hardware_study(tmp_path)
    failing = PlantedRunner(judged=False, fails=("P01-01",))
    person = ScriptedConsole("g", "a", "g", "s")
    assert sit(study, person, failing) == 0
    assert "P01-01 could not be run: P01-01: the rig fell over" in person.said
    states = [attempt.state for attempt in study.load().trials[0].attempts]
    assert states == [AttemptState.FAILED] * 2
    assert sit(study, ScriptedConsole(*SUCCESS, "s")) == 1


def test_ctrl_c_during_a_trial_keeps_the_study(tmp_path: Path) -> None:
    study = hardware_study(tmp_path)
    person = ScriptedConsole("g")
    with pytest.raises(KeyboardInterrupt):
        sit(study, person, PlantedRunner(interrupted=("P01-01",)))
    assert "goes on from here" in person.said[-1]
    attempt = study.load().trials[0].last
    assert attempt.state is AttemptState.INTERRUPTED


def test_practice_needs_no_verdict(tmp_path: Path) -> None:
    study = hardware_study(tmp_path, study__practice_trials=1)
    assert sit(study, ScriptedConsole("g", *SUCCESS, "s")) == 2
    done = [trial for trial in study.load().trials if trial.is_done]
    assert [trial.practice for trial in done] == [True, False]
    assert done[0].attempts[0].verdict is None


def test_each_participant_has_a_sitting(tmp_path: Path) -> None:
    study = hardware_study(tmp_path, 2)
    assert sit(study, ScriptedConsole(*SUCCESS, "s"), participant="P02") == 1
    assert study.load().left[0].participant == "P01"
    with pytest.raises(ConfigError, match="is no participant"):
        sit(study, ScriptedConsole(), participant="P05")
    study.forget(study.load(), "P02")
    with pytest.raises(ConfigError, match="was forgotten"):
        sit(study, ScriptedConsole(), participant="P02")
    assert sit(study, ScriptedConsole(*SUCCESS, *SUCCESS)) == 2
    person = ScriptedConsole()
    assert sit(study, person) == 0
    assert person.said == ["All trials of this study are done."]
