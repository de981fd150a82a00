"""`run_tams.py calibrate phases`, from trials to a file that the next session uses."""

from __future__ import annotations

import io
import shutil
from contextlib import redirect_stdout
from dataclasses import replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml

from calibration.kit import quiet
from calibration.options import PhaseOptions
from calibration.phases import wizard
from calibration.phases.fit import CODE, NOT_COUNTED, PhaseFit, Trial, evaluate, fit_thresholds
from calibration.phases.labels import Material, logged_trials
from calibration.phases.wizard import PhaseWizard
from tams_app import cli
from tams_app.config import DEFAULT_CONFIG, PhasesConfig, load_config
from tams_app.console.replay.marks import Mark, write_marks
from tams_app.errors import ConfigError, LogError, SetupError, TamsError
from tams_app.recording import LOG_NAME, read_log
from tams_app.records import Phase
from tams_app.units import NS_PER_S
from tests.calibration.lab import files, in_force, write_lab
from tests.calibration.phase_trials import PICK, PLACE, WHOLE, Leg, record, session, walk
from tests.scripted_ui import ScriptedUI
from tests.synthetic_session import START_NS

pytestmark = pytest.mark.untimed

LITE6_CONFIG = DEFAULT_CONFIG.with_name("lite6.yaml")
THINNED = 4  # of so many ticks one: searching takes its time
AWAY = Leg(0.7, (0.35, -0.15, 0.22))
# three people: one goes straight to it, one looks from above first, one is slow
PEOPLE = (
    WHOLE,
    (AWAY, *WHOLE),
    tuple(Leg(1.3 * leg.seconds, leg.to, leg.then_closed) for leg in (*PICK, *PLACE)),
)


@pytest.fixture(scope="module")
def logs(tmp_path_factory) -> tuple[Path, ...]:
    folder = tmp_path_factory.mktemp("logs")
    return tuple(
        record(folder / f"trial-{number}", *session(walk(legs), every=THINNED))
        for number, legs in enumerate(PEOPLE)
    )


@pytest.fixture(scope="module")
def unlabelled(tmp_path_factory) -> tuple[Path, ...]:
    """The same trials as hardware would log them: it is not known where the block was."""
    folder = tmp_path_factory.mktemp("unlabelled")
    return tuple(
        record(folder / f"trial-{number}", session(walk(legs), every=THINNED)[0], [], rig=False)
        for number, legs in enumerate(PEOPLE)
    )


@pytest.fixture
def own_logs(unlabelled, tmp_path) -> tuple[Path, ...]:
    """Copies of those, to lay marks beside."""
    return tuple(shutil.copytree(log, tmp_path / log.name) for log in unlabelled)


def calibrate(config_path: Path, ui: ScriptedUI | None = None, **options) -> int:
    options = PhaseOptions(config=config_path, **options)
    return PhaseWizard(ui or ScriptedUI(), options).run()


def labelled(folders: tuple[Path, ...]) -> Material:
    return logged_trials(folders, 100.0, quiet)


@pytest.fixture(scope="module")
def found(logs) -> PhaseFit:
    return fit_thresholds(labelled(logs).trials, 100.0)


@pytest.fixture(scope="module")
def written(logs, found, tmp_path_factory) -> tuple[Path, str]:
    """A configuration whose phases were calibrated from the logs, and what the command said."""
    config_path = write_lab(tmp_path_factory.mktemp("written"))
    arguments = ["calibrate", "phases", "--config", str(config_path)]
    arguments += [part for log in logs for part in ("--from", str(log))]

    def fit(trials: list[Trial], smoothing_ms: float, *_) -> PhaseFit:
        assert smoothing_ms == 100.0
        assert [trial.name for trial in trials] == ["trial-0", "trial-1", "trial-2"]
        return found  # which takes its time

    with redirect_stdout(io.StringIO()) as said, pytest.MonkeyPatch.context() as patch:
        patch.setattr(wizard, "fit_thresholds", fit)
        assert cli._main(arguments) == 0
    return config_path, said.getvalue()


def test_recorded_trials_become_thresholds_that_the_next_session_uses(written, found) -> None:
    config = load_config(written[0])
    _, content = in_force(written[0])
    chosen = content["config"]["policy"]["phases"]
    assert set(chosen) == set(PhasesConfig.model_fields) - {"inference", "smoothing_ms"}
    assert config.policy.phases == PhasesConfig(**chosen) != PhasesConfig()
    assert content["calibration"]["source"] == "recorded trials: trial-0, trial-1, trial-2"
    assert "frame-wise accuracy" in written[1]
    assert config.policy.phases == found.thresholds
    figures = content["calibration"]["quality"]
    shown = ("accuracy_in_sample", "accuracy_defaults", "accuracy_leave_one_trial_out")
    scores = (found.in_sample, found.defaults, found.left_out)
    assert [figures[key] for key in shown] == [round(one.accuracy, 4) for one in scores]
    assert sum(map(sum, figures["confusion_true_by_inferred"].values())) == figures["ticks"]


def test_held_out_trials_are_judged_by_and_not_learned_from(
    logs, found, config_path, monkeypatch
) -> None:
    trials = labelled(logs).trials
    learned: list[list[Trial]] = []

    def made(_config, seeds, unseen, *_) -> Material:
        assert (list(seeds), unseen) == ([7, 8, 9, 10], 1)
        return Material(trials, [trials[1]], "simulated", True)

    def fit(given, *_) -> PhaseFit:
        learned.append(given)
        return found

    monkeypatch.setattr(wizard, "virtual_trials", made)
    monkeypatch.setattr(wizard, "fit_thresholds", fit)
    options = {"sim": True, "trials": 3, "held_out": 1, "seed": 7}
    assert calibrate(config_path, **options) == 0
    assert learned == [trials]
    figures = in_force(config_path)[1]["calibration"]["quality"]
    for name, thresholds in (("", found.thresholds), ("_defaults", PhasesConfig())):
        accuracy = evaluate([trials[1]], thresholds).accuracy
        assert figures[f"accuracy_held_out{name}"] == pytest.approx(accuracy, abs=1e-4)


def test_no_thresholds_are_put_in_force_that_do_no_better_than_the_defaults(
    logs, found, config_path, monkeypatch
) -> None:
    no_better = replace(found, left_out=found.defaults)
    monkeypatch.setattr(wizard, "fit_thresholds", lambda *_: no_better)
    with pytest.raises(TamsError, match=r"do no better than the defaults .*--accept-unfounded"):
        calibrate(config_path, logs=logs)
    assert load_config(config_path).calibrated_by == ()
    (kept,) = files(config_path, "phases")
    assert "no better" in yaml.safe_load(kept.read_text())["calibration"]["unfounded"]
    ui = ScriptedUI()
    assert calibrate(config_path, ui, logs=logs, accept_unfounded=True) == 0
    assert any("Note: On a trial that they were not learned from" in text for text in ui.said)
    assert len(load_config(config_path).calibrated_by) == 1


def mark(folders: tuple[Path, ...]) -> None:
    """Marks beside each log, as its replay writes them."""
    for folder in folders:
        ticks = read_log(folder / LOG_NAME).ticks
        closes, opens = (
            (tick.started_ns - START_NS) / NS_PER_S
            for before, tick in pairwise(ticks)
            if before.arm.gripper_closed != tick.arm.gripper_closed
        )
        begins = (0.6, 1.6, closes, closes + 0.4, 5.5, opens)
        marks = map(Mark, begins, Phase)
        write_marks(folder / "phases.csv", [*marks, Mark(opens + 0.4, None)])


def test_marks_take_the_place_of_a_scene_that_nobody_recorded(logs, own_logs) -> None:
    mark(own_logs)
    found = labelled((logs[0], *own_logs[1:]))
    assert found.source == "recorded trials: trial-0, trial-1 (marked), trial-2 (marked)"
    for trial in found.trials[1:]:
        closes = int(np.argmax([bool(closed) for _, _, closed, _ in trial.motion.inputs]))
        assert trial.labels[0] == NOT_COUNTED
        assert trial.labels[closes + 1] == CODE[Phase.GRASP]


def test_a_log_whose_phases_nobody_knows_says_how_to_mark_it(unlabelled, config_path) -> None:
    with pytest.raises(ConfigError, match=r"trial-0: its phases are not known.*replay .*--mark"):
        calibrate(config_path, logs=unlabelled)


def test_bad_marks_stop_it_with_their_line(own_logs, config_path) -> None:
    (own_logs[0] / "phases.csv").write_text("t_s,phase\n1.0,REACH\n900,ALIGN\n")
    with pytest.raises(ConfigError, match=r"phases\.csv: line 3: 900 s is outside the log"):
        calibrate(config_path, logs=own_logs)


def test_only_trials_of_real_devices_count_for_real_devices(
    logs, own_logs, found, tmp_path, monkeypatch
) -> None:
    monkeypatch.setattr(wizard, "fit_thresholds", lambda *_: found)
    config_path = shutil.copy(LITE6_CONFIG, tmp_path / "lite6.yaml")
    mark(own_logs)
    with pytest.raises(ConfigError, match="has real devices"):
        calibrate(config_path, logs=(logs[0], *own_logs[1:]))
    assert not load_config(config_path).calibrated_by
    assert calibrate(config_path, logs=own_logs) == 0
    assert load_config(config_path).calibrated_by


def test_a_copy_of_a_log_is_no_trial_of_its_own(logs, config_path, tmp_path) -> None:
    copy = shutil.copytree(logs[0], tmp_path / "trial-3")
    with pytest.raises(ConfigError, match=r"trial-3: is a copy of .*trial-0"):
        calibrate(config_path, logs=(*logs, copy))


def test_without_mujoco_simulated_trials_say_what_is_missing(config_path, monkeypatch) -> None:
    monkeypatch.setattr("calibration.phases.labels.find_spec", lambda _: None)
    with pytest.raises(SetupError, match="need MuJoCo"):
        calibrate(config_path, sim=True)


@pytest.mark.parametrize("ticks", [[], session(walk(PICK))[0]])
def test_a_log_without_a_state_of_the_arm_is_refused_with_its_name(
    logs, config_path, tmp_path, ticks
) -> None:
    blind = record(tmp_path / "blind", [replace(tick, arm=None) for tick in ticks], [])
    with pytest.raises(LogError, match="blind: has no state of the arm in it"):
        calibrate(config_path, logs=(*logs[:2], blind))


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({}, "say where the trials come from"),
        ({"sim": True, "logs": (Path("a"),)}, "say where the trials come from"),
        ({"logs": (Path("a"),) * 3, "trials": 5}, "--trials and --held-out are for --sim"),
        ({"logs": (Path("a"), Path("b"))}, "2 trials are too few .* give at least 3"),
        ({"sim": True, "trials": 2}, "2 trials are too few"),
        ({"logs": (Path("a"),)}, "1 trial is too few"),
        ({"logs": (Path("a"), Path("b"), Path("c"))}, "a: there is no such folder"),
    ],
)
def test_wrong_use_is_refused_before_anything_is_made(config_path, options, reason) -> None:
    with pytest.raises(TamsError, match=reason) as error:
        calibrate(config_path, **options)
    assert error.value.exit_code == 2
