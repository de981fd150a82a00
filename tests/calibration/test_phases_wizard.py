"""`run_tams.py calibrate phases`, from trials to a file that the next session uses."""

from __future__ import annotations

import io
import re
import shutil
from contextlib import redirect_stdout
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
import yaml

from calibration.options import PhaseOptions
from calibration.phases import wizard
from calibration.phases.fit import PhaseFit, evaluate, fit_thresholds
from calibration.phases.labels import LabelRules
from calibration.phases.sources import Material, logged_trials
from calibration.phases.trials import CODE, NOT_COUNTED, Trial
from calibration.phases.wizard import PhaseWizard
from tams_app import cli
from tams_app.config import DEFAULT_CONFIG, PhasesConfig, load_config
from tams_app.console.replay.marks import Mark, write_marks
from tams_app.errors import ConfigError, LogError, SetupError, TamsError
from tams_app.recording import LOG_NAME, read_log
from tams_app.records import Phase
from tams_app.units import NS_PER_S
from tests.calibration.phase_trials import PICK, PLACE, WHOLE, Leg, record, session, walk
from tests.scripted_ui import ScriptedUI
from tests.synthetic_session import START_NS

pytestmark = pytest.mark.untimed

NOON = datetime(2026, 11, 21, 12, 0, 0, tzinfo=UTC)
STAMP = "20261121T120000Z"
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


@pytest.fixture
def config_path(tmp_path: Path) -> Path:
    path = tmp_path / "tams.yaml"
    shutil.copy(DEFAULT_CONFIG, path)
    return path


def calibrate(config_path: Path, ui: ScriptedUI, **options) -> int:
    return PhaseWizard(ui, PhaseOptions(config=config_path, **options), lambda: NOON).run()


def labelled(folders: tuple[Path, ...]) -> Material:
    return logged_trials(folders, 100.0, LabelRules(), lambda *_: None)


@dataclass(frozen=True)
class Declined:
    """What was found in the logs and then not wanted."""

    folder: Path
    ui: ScriptedUI
    found: PhaseFit


@pytest.fixture(scope="module")
def declined(logs, tmp_path_factory) -> Declined:
    folder = tmp_path_factory.mktemp("declined")
    shutil.copy(DEFAULT_CONFIG, folder / "tams.yaml")
    ui, found = ScriptedUI(["n"]), list[PhaseFit]()

    def fit(*arguments) -> PhaseFit:
        found.append(fit_thresholds(*arguments))
        return found[0]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(wizard, "fit_thresholds", fit)
        assert calibrate(folder / "tams.yaml", ui, logs=logs) == 0
    return Declined(folder, ui, found[0])


@pytest.fixture
def fitted(declined, monkeypatch) -> None:
    """The wizard does not search: for what comes before and after that."""
    monkeypatch.setattr(wizard, "fit_thresholds", lambda *_: declined.found)
    monkeypatch.setattr(wizard, "sensitivity", lambda *_: ["a curve"])
    monkeypatch.setattr(wizard, "save_sensitivity", lambda _, path: path.write_bytes(b"drawn"))


@dataclass(frozen=True)
class Written:
    """Where a configuration's phases were calibrated from the logs, and what the command said."""

    folder: Path
    config_path: Path
    said: str


@pytest.fixture(scope="module")
def written(logs, tmp_path_factory) -> Written:
    folder = tmp_path_factory.mktemp("written")
    config_path = folder / "tams.yaml"
    shutil.copy(DEFAULT_CONFIG, config_path)
    arguments = ["calibrate", "phases", "--config", str(config_path), "--yes"]
    arguments += [part for log in logs for part in ("--from", str(log))]
    with redirect_stdout(io.StringIO()) as said:
        assert cli._main([*arguments, "--picture", str(folder / "seen.png")]) == 0
    return Written(folder, config_path, said.getvalue())


def file_in_force(folder: Path) -> Path:
    (name,) = load_config(folder / "tams.yaml").calibrated_by
    return folder / "calibration" / "rig" / name


def test_recorded_trials_become_thresholds_that_the_next_session_uses(written) -> None:
    config = load_config(written.config_path)
    content = yaml.safe_load(file_in_force(written.folder).read_text(encoding="utf-8"))
    chosen = content["config"]["policy"]["phases"]
    assert set(chosen) == set(PhasesConfig.model_fields) - {"inference", "smoothing_ms"}
    assert config.policy.phases == PhasesConfig(**chosen) != PhasesConfig()
    assert content["calibration"]["source"] == "recorded trials: trial-0, trial-1, trial-2"


@pytest.mark.verify
def test_the_figures_kept_are_those_of_algorithm_1_over_the_trials(logs, declined, written) -> None:
    thresholds = load_config(written.config_path).policy.phases
    content = yaml.safe_load(file_in_force(written.folder).read_text(encoding="utf-8"))
    figures = content["calibration"]["quality"]
    trials = labelled(logs).trials
    assert thresholds == declined.found.thresholds
    assert figures["accuracy_in_sample"] == pytest.approx(
        evaluate(trials, thresholds).accuracy, abs=1e-4
    )
    assert figures["accuracy_defaults"] == pytest.approx(
        evaluate(trials, PhasesConfig()).accuracy, abs=1e-4
    )
    assert figures["accuracy_in_sample"] > figures["accuracy_defaults"]
    assert figures["accuracy_leave_one_trial_out"] == pytest.approx(
        declined.found.left_out.accuracy, abs=1e-4
    )
    assert sum(map(sum, figures["confusion_true_by_inferred"].values())) == figures["ticks"]


def test_the_figure_lies_beside_the_file(written) -> None:
    file = file_in_force(written.folder)
    figure = file.with_suffix(".png").read_bytes()
    assert figure.startswith(b"\x89PNG")
    assert figure == (written.folder / "seen.png").read_bytes()


def test_delays_are_told_with_their_unit_and_without_codes_of_a_terminal(written) -> None:
    header = next(line for line in written.said.splitlines() if line.strip().startswith("switch"))
    columns = ["switch to", "found", "missed", "spurious", "delay median [s]", "90 % [s]"]
    assert re.split(r"\s{2,}", header.strip()) == columns
    assert "\x1b" not in written.said


def test_what_was_found_is_said_before_it_is_asked_whether_to_write(declined) -> None:
    said = declined.ui.said
    before = "\n".join(said[: said.index("Write it? [y/n] ")])
    for text in ("v_eps_mm_s", "true \\ inferred", "missed", "frame-wise accuracy", "defaults"):
        assert text in before


def test_after_a_no_nothing_is_written_and_nothing_changes(declined) -> None:
    assert not (declined.folder / "calibration").exists()
    assert load_config(declined.folder / "tams.yaml").policy.phases == PhasesConfig()


def test_progress_is_shown_while_it_searches(declined) -> None:
    assert len(declined.ui.shown) > 20


def test_held_out_trials_are_judged_by_and_not_learned_from(
    logs, declined, config_path, monkeypatch
) -> None:
    trials = labelled(logs).trials
    learned: list[list[Trial]] = []

    def made(_config, seeds, unseen, *_) -> Material:
        assert (list(seeds), unseen) == ([7, 8, 9, 10], 1)
        return Material(trials, [trials[1]], "simulated", True)

    def fit(given, *_) -> PhaseFit:
        learned.append(given)
        return declined.found

    monkeypatch.setattr(wizard, "virtual_trials", made)
    monkeypatch.setattr(wizard, "fit_thresholds", fit)
    monkeypatch.setattr(wizard, "sensitivity", lambda *_: ["a curve"])
    monkeypatch.setattr(wizard, "save_sensitivity", lambda _, path: path.write_bytes(b"drawn"))
    options = {"sim": True, "trials": 3, "held_out": 1, "seed": 7}
    assert calibrate(config_path, ScriptedUI(), yes=True, **options) == 0
    assert learned == [trials]
    content = yaml.safe_load(file_in_force(config_path.parent).read_text(encoding="utf-8"))
    figures = content["calibration"]["quality"]
    for name, thresholds in (("", declined.found.thresholds), ("_defaults", PhasesConfig())):
        accuracy = evaluate([trials[1]], thresholds).accuracy
        assert figures[f"accuracy_held_out{name}"] == pytest.approx(accuracy, abs=1e-4)


@pytest.mark.usefixtures("fitted")
def test_with_nobody_to_ask_nothing_is_written(logs, config_path) -> None:
    ui = ScriptedUI()
    assert calibrate(config_path, ui, logs=logs) == 1
    assert any("v_eps_mm_s" in text for text in ui.said)
    assert not (config_path.parent / "calibration").exists()


@pytest.mark.usefixtures("fitted")
def test_yes_puts_no_thresholds_in_force_that_do_no_better_than_the_defaults(
    logs, declined, config_path, monkeypatch
) -> None:
    no_better = replace(declined.found, left_out=declined.found.defaults)
    monkeypatch.setattr(wizard, "fit_thresholds", lambda *_: no_better)
    with pytest.raises(TamsError, match=r"do no better than the defaults .*--accept-unfounded"):
        calibrate(config_path, ScriptedUI(), logs=logs, yes=True)
    assert load_config(config_path).calibrated_by == ()
    (kept,) = (config_path.parent / "calibration" / "rig").glob("phases-*.yaml")
    assert "no better" in yaml.safe_load(kept.read_text())["calibration"]["unfounded"]
    ui = ScriptedUI(["n"])  # a person is asked, and knows why
    assert calibrate(config_path, ui, logs=logs) == 0
    assert "do no better than the defaults" in ui.console.asked[-1]
    assert load_config(config_path).calibrated_by == ()
    accepted = {"yes": True, "accept_unfounded": True}
    assert calibrate(config_path, ScriptedUI(), logs=logs, **accepted) == 0
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


def test_marks_take_the_place_of_a_scene_that_nobody_recorded(own_logs) -> None:
    mark(own_logs)
    found = labelled(own_logs)
    assert found.source == "recorded trials: trial-0 (marked), trial-1 (marked), trial-2 (marked)"
    for trial in found.trials:
        closes = int(np.argmax([bool(closed) for _, _, closed, _ in trial.motion.inputs]))
        assert trial.labels[0] == NOT_COUNTED
        assert trial.labels[closes + 1] == CODE[Phase.GRASP]


@pytest.mark.usefixtures("fitted")
def test_after_a_yes_the_file_says_which_trials_a_person_marked(
    logs, own_logs, config_path
) -> None:
    mark(own_logs)
    folders = (logs[0], *own_logs[1:])
    ui = ScriptedUI(["y"])
    assert calibrate(config_path, ui, logs=folders, goal_height_mm=100.0) == 0
    assert load_config(config_path).calibrated_by == (f"phases-{STAMP}.yaml",)
    content = yaml.safe_load(file_in_force(config_path.parent).read_text(encoding="utf-8"))
    assert content["calibration"]["source"] == (
        "recorded trials: trial-0, trial-1 (marked), trial-2 (marked); "
        "align and pre-release only below 100 mm"
    )


@pytest.mark.usefixtures("fitted")
def test_marks_know_no_height(own_logs, config_path) -> None:
    mark(own_logs)
    assert calibrate(config_path, ScriptedUI(["y"]), logs=own_logs, goal_height_mm=100.0) == 0
    assert "below" not in file_in_force(config_path.parent).read_text(encoding="utf-8")


def test_marking_without_a_display_says_what_it_needs(own_logs, config_path, monkeypatch) -> None:
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    with pytest.raises(SetupError, match="start it where there is a display, or write"):
        calibrate(config_path, ScriptedUI(), logs=own_logs, mark=True)


def test_a_log_whose_phases_nobody_knows_says_how_to_mark_it(unlabelled, config_path) -> None:
    with pytest.raises(ConfigError, match=r"trial-0: its phases are not known.*--mark"):
        calibrate(config_path, ScriptedUI(), logs=unlabelled)


def test_bad_marks_stop_it_with_their_line(own_logs, config_path) -> None:
    (own_logs[0] / "phases.csv").write_text("t_s,phase\n1.0,REACH\n900,ALIGN\n")
    with pytest.raises(ConfigError, match=r"phases\.csv: line 3: 900 s is outside the log"):
        calibrate(config_path, ScriptedUI(), logs=own_logs)


@pytest.mark.usefixtures("fitted")
def test_only_trials_of_real_devices_count_for_real_devices(logs, own_logs, tmp_path) -> None:
    config_path = shutil.copy(LITE6_CONFIG, tmp_path / "lite6.yaml")
    mark(own_logs)
    with pytest.raises(ConfigError, match="has real devices"):
        calibrate(config_path, ScriptedUI(), logs=(logs[0], *own_logs[1:]), yes=True)
    with pytest.raises(ConfigError, match="has real devices"):
        calibrate(config_path, ScriptedUI(), sim=True, yes=True)
    assert not load_config(config_path).calibrated_by
    assert calibrate(config_path, ScriptedUI(), logs=own_logs, yes=True) == 0
    assert load_config(config_path).calibrated_by


def test_a_copy_of_a_log_is_no_trial_of_its_own(logs, config_path, tmp_path) -> None:
    copy = shutil.copytree(logs[0], tmp_path / "trial-3")
    with pytest.raises(ConfigError, match=r"trial-3: is a copy of .*trial-0"):
        calibrate(config_path, ScriptedUI(), logs=(*logs, copy))


def test_a_log_in_which_nothing_happened_is_refused_with_its_name(
    logs, config_path, tmp_path, monkeypatch
) -> None:
    empty = record(tmp_path / "empty", [], [])
    with pytest.raises(LogError, match="empty: has no state of the arm"):
        calibrate(config_path, ScriptedUI(), logs=(*logs[:2], empty))
    monkeypatch.setenv("DISPLAY", ":none")
    with pytest.raises(LogError, match="empty: has no state of the arm"):
        calibrate(config_path, ScriptedUI(), logs=(empty,), mark=True)


def test_without_mujoco_simulated_trials_say_what_is_missing(config_path, monkeypatch) -> None:
    monkeypatch.setattr("calibration.phases.sources.find_spec", lambda _: None)
    with pytest.raises(SetupError, match="need MuJoCo"):
        calibrate(config_path, ScriptedUI(), sim=True)


def test_a_log_without_an_arm_is_refused_with_its_name(logs, config_path, tmp_path) -> None:
    ticks, scene = session(walk(PICK))
    for tick in ticks:
        object.__setattr__(tick, "arm", None)
    blind = record(tmp_path / "blind", ticks, scene)
    with pytest.raises(LogError, match="blind: has no state of the arm"):
        calibrate(config_path, ScriptedUI(), logs=(*logs[:2], blind))


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({}, "say where the trials come from"),
        ({"sim": True, "logs": (Path("a"),)}, "say where the trials come from"),
        ({"sim": True, "mark": True}, "--mark is for recorded logs"),
        ({"logs": (Path("a"),) * 3, "trials": 5}, "--trials and --held-out are for --sim"),
        ({"logs": (Path("a"), Path("b"))}, "2 trials are too few"),
        ({"sim": True, "trials": 2}, "2 trials are too few"),
        ({"logs": (Path("a"),)}, "1 trial is too few"),
        ({"logs": (Path("a"), Path("b"), Path("a"))}, "a: is given twice"),
        ({"logs": (Path("a"), Path("b"), Path("c"))}, "a: is no session folder"),
        ({"sim": True, "figure": Path("nowhere/a.png")}, "there is no folder nowhere"),
        ({"sim": True, "figure": Path("a.pdf")}, "is drawn to"),
        ({"sim": True, "goal_height_mm": 0.0}, "must be more than 0"),
    ],
)
def test_wrong_use_is_refused_before_anything_is_made(config_path, options, reason) -> None:
    with pytest.raises(ConfigError, match=reason):
        calibrate(config_path, ScriptedUI(), **options)


def test_the_command_line_takes_logs_and_tells_by_its_exit_code(logs, written, capsys) -> None:
    assert "frame-wise accuracy" in written.said
    arguments = ["calibrate", "phases", "--config", str(written.config_path)]
    assert cli._main([*arguments, "--from", str(logs[0])]) == 2
    assert "1 trial is too few" in capsys.readouterr().err
