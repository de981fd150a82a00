"""The study's folder: whole after a crash at any point, never overwritten, deletable."""

from __future__ import annotations

from pathlib import Path

import pytest

import tams_app.study.folder as folder_module
from tams_app.config import load_config
from tams_app.errors import ConfigError
from tams_app.study.folder import StudyFolder
from tams_app.study.plan import AttemptState, ParticipantState
from tams_app.study.planning import make_plan
from tams_app.study.runner import mark_ended
from tests.study.synthetic_study import PlantedRunner, fill_study, make_study, small_config

pytestmark = pytest.mark.untimed


class Crash(BaseException):
    """The process died here."""


def test_what_was_planned_is_read_back(tmp_path: Path) -> None:
    study = make_study(tmp_path / "study")
    assert study.load() == make_plan(small_config(), 2)
    assert study.config() == small_config()


def test_a_missing_or_wrong_plan_is_one_sentence(tmp_path: Path) -> None:
    study = StudyFolder(tmp_path)
    with pytest.raises(ConfigError, match=r"holds no plan\.json"):
        study.load()
    (tmp_path / "plan.json").write_text('{"schema_version": 2}')
    with pytest.raises(ConfigError, match="schema_version"):
        study.load()
    (tmp_path / "plan.json").write_text("{")
    with pytest.raises(ConfigError, match=r"plan\.json"):
        study.load()


def test_two_commands_cannot_work_on_one_study(tmp_path: Path) -> None:
    study = make_study(tmp_path)
    with (
        study.locked(),
        pytest.raises(ConfigError, match="another command"),
        StudyFolder(tmp_path).locked(),
    ):
        pass
    with study.locked():  # and it is free again
        pass


def test_an_attempt_never_takes_a_folder_that_is_there(tmp_path: Path) -> None:
    study = make_study(tmp_path)
    (tmp_path / "trials/P01/P01-01-a1").mkdir(parents=True)  # a crash came before it was noted
    _, attempt = study.new_attempt(study.load(), "P01-01")
    assert attempt.folder == "trials/P01/P01-01-a2"
    assert study.load().trial("P01-01").last == attempt


def test_after_a_crash_whole_trials_count_and_others_are_kept_and_retried(tmp_path: Path) -> None:
    study = make_study(tmp_path)
    plan = study.load()
    runner = PlantedRunner()
    folders = {}
    for trial in plan.trials[:4]:
        plan, attempt = study.new_attempt(plan, trial.id)
        folders[trial.id] = tmp_path / attempt.folder
    for trial in plan.trials[:3]:
        runner.run(trial, folders[trial.id])
    first, second, third, fourth = (trial.id for trial in plan.trials[:4])
    mark_ended(folders[first])
    mark_ended(folders[second])
    summary = folders[second] / "summary.json"
    summary.write_text(summary.read_text()[:100])  # torn
    recovered = study.recover()
    states = [recovered.trial(one).last.state for one in (first, second, third, fourth)]
    assert states == [AttemptState.DONE] + [AttemptState.INTERRUPTED] * 3
    assert study.load() == recovered
    again, attempt = study.new_attempt(recovered, fourth)
    assert attempt.folder.endswith("-a2")
    assert folders[fourth].is_dir()
    assert len(again.trial(fourth).attempts) == 2


def test_forgetting_deletes_one_participant_and_what_was_computed_from_them(tmp_path: Path) -> None:
    study = make_study(tmp_path)
    fill_study(study, PlantedRunner())
    for name in ("tables", "report"):
        (tmp_path / name).mkdir()
    before = study.load()
    plan = study.forget(before, "P01")
    assert not list(tmp_path.rglob("P01*"))
    assert not (tmp_path / "tables").exists()
    assert not (tmp_path / "report").exists()
    assert {trial.participant for trial in plan.trials} == {"P02"}
    assert plan.participant("P01").state is ParticipantState.FORGOTTEN
    assert study.load() == plan
    assert all((tmp_path / trial.attempts[0].folder).is_dir() for trial in plan.trials)
    with pytest.raises(ConfigError, match="is no participant"):
        study.forget(plan, "P07")


def test_forgetting_that_a_crash_cut_short_is_finished_by_the_next_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    study = make_study(tmp_path)
    fill_study(study, PlantedRunner())

    def crash(*_: object) -> None:
        raise Crash

    with monkeypatch.context() as patch:
        patch.setattr(folder_module.shutil, "rmtree", crash)
        with pytest.raises(Crash):
            study.forget(study.load(), "P01")
    assert (tmp_path / "trials/P01").is_dir()
    plan = study.recover()
    assert not (tmp_path / "trials/P01").exists()
    assert plan.participant("P01").state is ParticipantState.FORGOTTEN
    assert {trial.participant for trial in plan.trials} == {"P02"}


def test_a_trial_s_configuration_is_the_study_s_with_its_condition(
    tmp_path: Path,
) -> None:
    study = make_study(tmp_path)
    trial, given = study.load().trials[4], study.config()
    config = trial.configure(given)
    assert (config.strategy, config.network, config.seed) == (
        trial.strategy,
        trial.network,
        trial.seed,
    )
    default = load_config()
    assert (default.policy.budget.mode, default.video.repair.mode) == ("feedback", "adaptive")
    paper = load_config(None, {"policy.budget.mode": "oracle", "video.repair.mode": "paper"})
    assert config.policy == paper.policy
    assert config.video.repair == paper.video.repair
