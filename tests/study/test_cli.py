"""`run_tams.py study` as it is typed: options, refusals, and going on after an interruption."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

import tams_app.study.commands
from tams_app.cli import _main
from tams_app.config import CONFIG_DIRECTORY, DEFAULT_CONFIG, load_config
from tams_app.errors import TamsError
from tams_app.study import live_trial, runner
from tams_app.study.folder import StudyFolder
from tams_app.study.plan import AttemptState, conditions_of_all
from tams_app.study.runner import TrialRunner, mark_ended
from tams_app.study.trial_process import Job
from tests.study.synthetic_study import PlantedRunner
from tests.study.test_guided import SUCCESS

pytestmark = pytest.mark.untimed

Run = Callable[..., tuple[int, str, str]]
PLAYED = PlantedRunner()


class PlayedPool:
    """Trials one after the other in this process: what runs them apart is tested elsewhere."""

    slots = 1

    def __init__(self, runner: TrialRunner, workers: int | None = None) -> None:
        self._runner = runner
        self._ended: list[tuple[Job, str]] = []

    def start(self, job: Job) -> None:
        failure = ""
        try:
            self._runner.run(job.trial, job.folder)
            mark_ended(job.folder)
        except TamsError as error:
            failure = str(error)
        self._ended.append((job, failure))

    def wait(self) -> list[tuple[Job, str]]:
        ended, self._ended = self._ended, []
        return ended

    def close(self) -> None:
        """Nothing still runs."""


@pytest.fixture
def study(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Run:
    """Run a sub-command with played trials: exit code, standard output, standard error."""
    monkeypatch.setenv("COLUMNS", "200")

    def run(*arguments: object, played: TrialRunner = PLAYED) -> tuple[int, str, str]:
        monkeypatch.setattr(runner, "SimulatedTrialRunner", lambda _config: played)
        monkeypatch.setattr(tams_app.study.commands, "LocalPool", PlayedPool)
        code = _main(["study", *map(str, arguments)])
        return (code, *capsys.readouterr())

    return run


def configuration(path: Path, base: Path = DEFAULT_CONFIG, **more: Any) -> Path:
    """A study of two conditions, so that it is soon done."""
    small = {"strategies": ["equal", "tams"], "networks": ["s1"], "repetitions": 1}
    content = {"include": [str(base)], "study": small, **more}
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


@pytest.fixture
def config(tmp_path: Path) -> Path:
    return configuration(tmp_path / "study.yaml")


def test_plan_run_show_void_report_forget(study: Run, config: Path, tmp_path: Path) -> None:
    out = tmp_path / "s"
    words = ("--participants", 2, "--practice", 1, "--seed", 4, "--sim", "--out", out)
    code, text, _ = study("plan", *words, "--config", config)
    assert code == 0
    assert "6 trials, simulated operators" in text
    assert "Counterbalanced: 2 participants" in text
    assert StudyFolder(out).load().seed == 4

    code, text, _ = study("run", "--sim", out, "--workers", 2)
    assert (code, "6 trials done, 0 failed." in text) == (0, True)
    assert study("void", "P01-02", out, "--reason", "the light went out")[0] == 0
    code, text, _ = study("show", out)
    assert (code, "P01-02" in text) == (0, True)
    assert study("run", "--sim", "--out", out)[0] == 0
    trial = StudyFolder(out).load().trial("P01-02")
    assert [one.state for one in trial.attempts] == [AttemptState.VOID, AttemptState.DONE]
    assert trial.attempts[0].reason == "the light went out"

    code, text, err = study("forget", "P02", out)  # there is no terminal to ask at
    assert (code, text, "add --yes" in err, len(err.splitlines())) == (2, "", True, 1)
    assert (out / "trials" / "P02").exists()
    code, text, _ = study("forget", "P02", out, "--yes")
    assert (code, "P02 is forgotten: 3 trials" in text) == (0, True)
    assert "What remains: 3 finished trials of the others" in " ".join(text.split())
    assert not (out / "trials" / "P02").exists()
    assert "forgotten" in study("show", out)[1]
    code, _, err = study("run", out)
    assert (code, "is planned for the simulated rig: add --sim" in err) == (2, True)


def test_report_writes_where_it_is_told_and_is_made_again_from_its_tables(
    study: Run, config: Path, tmp_path: Path, undrawn: None
) -> None:
    folder, tables = tmp_path / "s", tmp_path / "s" / "tables"
    study("run", "--sim", "--participants", 1, "--config", config, "--out", folder)
    code, text, err = study("report", folder, "--out", tmp_path / "r", "--tolerance-ssim", 0.02)
    assert (code, err) == (0, "writing tables and report …\n")
    told = [Path(line) for line in text.splitlines()]
    assert [path.name for path in told] == [
        "report.html",
        "trials.csv",
        "trials.parquet",
        "phases.csv",
        "phases.parquet",
    ]
    assert all(path.is_file() for path in told)
    text = " ".join((tmp_path / "r" / "report.html").read_text().split())
    assert "within 0.02 in SSIM" in text

    words = ("--config", config, "--tolerance-ssim", 0.02)
    assert study("report", "--from-tables", tables, *words)[0] == 0
    pages = [path / "report.html" for path in (tmp_path / "r", tables)]
    assert len({path.read_text() for path in pages}) == 1
    code, _, err = study("report", "--from-tables", tables)  # planned otherwise by default
    assert (code, "give the study's own with --config" in err) == (2, True)


def test_a_study_without_results_has_no_report(study: Run, config: Path, tmp_path: Path) -> None:
    out = tmp_path / "s"
    study("plan", "--participants", 1, "--config", config, "--out", out)
    code, text, err = study("report", out)
    assert (code, text, "no trial is done yet" in err) == (2, "", True)
    assert not (out / "report").exists()


def test_the_same_command_plans_runs_and_then_finds_all_done(
    study: Run, config: Path, tmp_path: Path
) -> None:
    words = ("run", "--sim", "--participants", 1, "--config", config, "--out", tmp_path / "s")
    assert study(*words, played=PlantedRunner(fails=("P01-02",)))[0] == 1
    code, text, _ = study(*words)
    assert (code, "1 trials done" in text) == (0, True)
    code, text, _ = study(*words)
    assert (code, "All trials of this study are done." in text) == (0, True)


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ([], "Missing command"),
        (["plan"], "Missing option '--participants'"),
        (["plan", "--participants", "0"], "participants: must be 1 to 9999, not 0"),
        (["plan", "--participants", "10000"], "participants: must be 1 to 9999, not 10000"),
        (["plan", "--participants", "1", "--repetitions", "0"], "study.repetitions"),
        (["plan", "--participants", "1", "--practice", "-1"], "study.practice_trials"),
        (["plan", "--participants", "1", "--seed", "-1"], "seed"),
        (["plan", "--participants", "1", "--config", "none.yaml"], "none.yaml: cannot be read"),
        (["plan", "new", "--participants", "1", "--out", "other"], "give one folder"),
        (["run", "--sim", "--out", "new"], "say how many with --participants"),
        (["run", "--participants", "1", "--out", "new"], "describes the simulated rig: add --sim"),
        (["run", "--workers", "2"], "--workers is for simulated trials: add --sim"),
        (["run", "--dask", "tcp://there:1"], "--dask is for simulated trials: add --sim"),
        (["run", "--sim", "--workers", "0"], "Invalid value for '--workers'"),
        (["run", "--sim", "--workers", "1", "--dask", "x:1"], "leave it out with --dask"),
        (["run", "--sim", "--participant", "P01"], "leave it out with --sim"),
        (["show", "new"], "make one with `study plan`"),
        (["void", "P01-01", "new", "--reason", "x"], "make one with `study plan`"),
        (["forget", "P01", "new", "--yes"], "make one with `study plan`"),
        (["forget", "P01", "--yes"], "Missing argument 'DIR'"),
        (["report", "new"], "make one with `study plan`"),
        (["report", "new", "--from-tables", "old"], "give one of them"),
        (["report", "--from-tables", "new"], "trials.csv: cannot be read"),
        (["report", "new", "--config", "c.yaml"], "--config is for --from-tables"),
        (["report", "new", "--tolerance-ssim", "-1"], "Invalid value for '--tolerance-ssim'"),
    ],
)
def test_wrong_use_is_one_sentence_exit_code_two_and_leaves_nothing_behind(
    study: Run,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    sentence: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    code, out, err = study(*arguments)
    assert (code, out) == (2, "")
    assert sentence in err
    assert len(err.splitlines()) == 1
    assert list(tmp_path.iterdir()) == []


def test_a_configuration_that_differs_only_in_what_studies_override_is_the_same_study() -> None:
    changes = {"policy.budget.mode": "oracle", "video.repair.mode": "paper"}
    usual, changed, other = (
        conditions_of_all(load_config(None, one))
        for one in ({}, changes, {"study.budget": "feedback"})
    )
    assert usual == changed != other


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        (["--repetitions", "2"], "was planned with --repetitions 1, not 2"),
        (["--practice", "1"], "was planned with --practice 0, not 1"),
        (["--seed", "8"], "was planned with --seed 0, not 8"),
        (["--participants", "2"], "is planned for 1 participants, not 2"),
        (["--config", "other.yaml"], "was planned with another configuration than other.yaml"),
    ],
)
def test_a_planned_study_is_not_run_as_another_one(
    study: Run,
    config: Path,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    arguments: list[str],
    sentence: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    configuration(tmp_path / "other.yaml", trial={"limit_s": 60})
    assert study("plan", "s", "--participants", 1, "--config", config)[0] == 0
    before = (tmp_path / "s" / "plan.json").read_bytes()
    code, out, err = study("run", "s", "--sim", *arguments)
    assert (code, out) == (2, "")
    assert sentence in err
    assert len(err.splitlines()) == 1
    assert (tmp_path / "s" / "plan.json").read_bytes() == before


def test_a_study_is_not_planned_over_another(study: Run, config: Path, tmp_path: Path) -> None:
    words = ("plan", tmp_path / "s", "--participants", 1, "--config", config)
    assert study(*words)[0] == 0
    code, _, err = study(*words)
    assert (code, "holds a study already" in err) == (2, True)


def test_dask_without_its_extra_is_one_sentence(
    study: Run, config: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tams_app.errors.find_spec", lambda name: None)
    words = ("run", tmp_path / "s", "--sim", "--participants", 1, "--config", config)
    code, _, err = study(*words, "--dask", "tcp://127.0.0.1:1")
    assert code == 1
    assert err == "tams: --dask needs distributed: make extras\n"
    assert study(*words)[0] == 0  # and nothing is in the way of running it here


def test_without_the_simulation_s_extra_a_sentence_says_what_to_install(
    study: Run, config: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("tams_app.study.cli.find_spec", lambda name: None)
    words = ("run", tmp_path / "s", "--sim", "--participants", 1, "--config", config)
    code, _, err = study(*words)
    assert code == 1
    assert err == "tams: simulated trials need MuJoCo: pip install mujoco\n"


def test_ctrl_c_leaves_a_study_that_goes_on(
    study: Run, config: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "s"
    words = ("run", "--sim", "--participants", 1, "--config", config, "--out", out)
    with pytest.raises(KeyboardInterrupt):
        study(*words, played=PlantedRunner(interrupted=("P01-02",)))
    text = capsys.readouterr().out
    assert "Stopped: 1 of 2 trials are done and kept." in text
    assert f"`study run --sim {out}` goes on" in text.replace("\n", "")
    kept = {path: path.read_bytes() for path in out.rglob("summary.json")}
    assert len(kept) == 1

    code, text, _ = study("run", "--sim", out)
    assert (code, "1 trials done, 0 failed." in text) == (0, True)
    states = [attempt.state for attempt in StudyFolder(out).load().trial("P01-02").attempts]
    assert states == [AttemptState.INTERRUPTED, AttemptState.DONE]
    assert {path: path.read_bytes() for path in kept} == kept


def test_people_are_guided_through_trials_whose_strategy_is_not_named(
    study: Run, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    config = configuration(tmp_path / "lab.yaml", CONFIG_DIRECTORY / "lite6.yaml")
    answers = ["g", "j", "y", "0", "44", "y", "s"]
    monkeypatch.setattr("builtins.input", lambda *_: answers.pop(0))
    monkeypatch.setattr(live_trial, "LiveTrialRunner", lambda config: PlantedRunner(judged=False))
    out = tmp_path / "s"
    code, text, _ = study("run", "--participants", 2, "--config", config, "--out", out)
    assert code == 0
    assert "block on start mark" in text
    assert f"`study run {out} --participant P01` goes on from here" in text
    assert "equal" not in text
    (trial,) = (trial for trial in StudyFolder(out).load().trials if trial.is_done)
    assert trial.attempts[0].verdict is not None
    assert trial.attempts[0].verdict.completion_time_s == 44.0

    answers += [*SUCCESS[:4], "50", "y", "s"]
    assert study("run", out, "--participant", "P02")[0] == 0
    assert [one.participant for one in StudyFolder(out).load().trials if one.is_done] == [
        "P01",
        "P02",
    ]
    code, _, err = study("run", out, "--sim")
    assert (code, "leave out --sim" in err) == (2, True)
    code, _, err = study("run", out, "--participant", "P07")
    assert (code, "is no participant of this study" in err) == (2, True)
