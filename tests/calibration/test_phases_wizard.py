"""`run_tams.py calibrate phases`, from trials to a file that the next session uses."""

from __future__ import annotations

import shutil
from datetime import UTC, datetime
from itertools import islice
from pathlib import Path

import numpy as np
import pytest
import yaml

from calibration.desk import PlayedDesk
from calibration.phases.fit import evaluate
from calibration.phases.labels import LabelRules
from calibration.phases.sources import logged_trials
from calibration.phases.trials import CODE, NOT_COUNTED, infer, motion_of
from calibration.phases.virtual_trial import VirtualTrial
from calibration.phases.wizard import Options, run_phases
from tams_app import cli
from tams_app.config import DEFAULT_CONFIG, PhasesConfig, load_config
from tams_app.errors import ConfigError, LogError
from tams_app.policy.phases import PhaseParameters
from tams_app.records import Phase
from tests.calibration.phase_trials import PICK, PLACE, WHOLE, Leg, record, session, walk

pytestmark = pytest.mark.timeout(1800)  # searching takes its time on a busy machine
NOON = datetime(2026, 11, 21, 12, 0, 0, tzinfo=UTC)
STAMP = "20261121T120000Z"
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
        record(folder / f"trial-{number}", *session(walk(legs)))
        for number, legs in enumerate(PEOPLE)
    )


@pytest.fixture(scope="module")
def unlabelled(tmp_path_factory) -> tuple[Path, ...]:
    """The same trials as hardware would log them: nobody knows where the block was."""
    folder = tmp_path_factory.mktemp("unlabelled")
    return tuple(
        record(folder / f"trial-{number}", session(walk(legs))[0], [])
        for number, legs in enumerate(PEOPLE)
    )


@pytest.fixture
def config_path(tmp_path: Path) -> Path:
    path = tmp_path / "tams.yaml"
    shutil.copy(DEFAULT_CONFIG, path)
    return path


def calibrate(config_path: Path, desk: PlayedDesk, **options) -> int:
    return run_phases(desk, config_path, Options(**options), lambda: NOON)


@pytest.fixture(scope="module")
def written(logs, tmp_path_factory) -> Path:
    """A configuration whose phases were calibrated from the logs, with a picture besides."""
    folder = tmp_path_factory.mktemp("written")
    shutil.copy(DEFAULT_CONFIG, folder / "tams.yaml")
    desk, picture = PlayedDesk(["y"]), folder / "seen.png"
    assert calibrate(folder / "tams.yaml", desk, logs=logs, picture=picture) == 0
    return folder


@pytest.fixture(scope="module")
def declined(logs, tmp_path_factory) -> tuple[Path, PlayedDesk]:
    """The same, answered with no."""
    folder = tmp_path_factory.mktemp("declined")
    shutil.copy(DEFAULT_CONFIG, folder / "tams.yaml")
    desk = PlayedDesk(["n"])
    assert calibrate(folder / "tams.yaml", desk, logs=logs) == 0
    return folder, desk


def file_in_force(folder: Path) -> Path:
    (name,) = load_config(folder / "tams.yaml").calibrated_by
    return folder / "calibration" / "rig" / name


def test_recorded_trials_become_thresholds_that_the_next_session_uses(logs, written) -> None:
    config = load_config(written / "tams.yaml")
    content = yaml.safe_load(file_in_force(written).read_text(encoding="utf-8"))
    chosen = content["config"]["policy"]["phases"]
    assert set(chosen) == set(PhasesConfig.model_fields) - {"smoothing_ms"}
    assert config.policy.phases == PhasesConfig(**chosen) != PhasesConfig()
    assert content["calibration"]["source"] == "recorded trials: trial-0, trial-1, trial-2"


def test_the_figures_kept_are_those_of_algorithm_1_over_the_trials(logs, written) -> None:
    thresholds = load_config(written / "tams.yaml").policy.phases
    content = yaml.safe_load(file_in_force(written).read_text(encoding="utf-8"))
    figures = content["calibration"]["quality"]
    trials = logged_trials(logs, 100.0, LabelRules(), lambda *_: None)
    assert figures["accuracy_in_sample"] == pytest.approx(
        evaluate(trials, thresholds).accuracy, abs=1e-4
    )
    assert figures["accuracy_defaults"] == pytest.approx(
        evaluate(trials, PhasesConfig()).accuracy, abs=1e-4
    )
    assert figures["accuracy_in_sample"] > figures["accuracy_defaults"]
    assert sum(map(sum, figures["confusion_true_by_inferred"].values())) == figures["ticks"]


def test_the_picture_lies_beside_the_file_that_names_it(written) -> None:
    file = file_in_force(written)
    content = yaml.safe_load(file.read_text(encoding="utf-8"))
    picture = file.parent / content["calibration"]["quality"]["picture"]
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert picture.read_bytes() == (written / "seen.png").read_bytes()


def test_what_was_found_is_said_before_it_is_asked_whether_to_write(declined) -> None:
    _, desk = declined
    before = "\n".join(desk.said[: desk.said.index("Write it? [y/n] ")])
    for text in ("v_eps_mm_s", "true \\ inferred", "missed", "frame-wise accuracy", "defaults"):
        assert text in before


def test_after_a_no_nothing_is_written_and_nothing_changes(declined) -> None:
    folder, _ = declined
    assert not (folder / "calibration").exists()
    assert load_config(folder / "tams.yaml").policy.phases == PhasesConfig()


def test_progress_is_shown_while_it_searches(declined) -> None:
    _, desk = declined
    assert len(desk.shown) > 20


def test_with_nobody_to_ask_nothing_is_written(logs, config_path) -> None:
    assert calibrate(config_path, PlayedDesk(), logs=logs) == 1
    assert not (config_path.parent / "calibration").exists()


def test_marks_take_the_place_of_a_scene_that_nobody_recorded(
    unlabelled, config_path, tmp_path
) -> None:
    folders = tuple(shutil.copytree(log, tmp_path / log.name) for log in unlabelled)
    marks = ["0.6 reach", "1.6 align", "g", "gra", "+0.4", "tra", "5.5 pre", "g", "rel", "+0.4"]
    desk = PlayedDesk([*marks, "rea", "q", *marks, "-", "q", *marks, "-", "q"])
    assert calibrate(config_path, desk, logs=folders, mark=True) == 0
    assert (folders[2] / "phases.csv").read_text().splitlines()[-1].endswith(",-")
    trials = logged_trials(folders, 100.0, LabelRules(), lambda *_: None)
    for trial in trials:
        closes = int(np.argmax([bool(closed) for _, _, closed, _ in trial.motion.inputs]))
        assert trial.labels[0] == NOT_COUNTED
        assert trial.labels[closes + 1] == CODE[Phase.GRASP]
    assert calibrate(config_path, PlayedDesk(["y"]), logs=folders) == 0
    assert load_config(config_path).calibrated_by == (f"phases-{STAMP}.yaml",)
    assert "trial-2 (marked)" in file_in_force(config_path.parent).read_text(encoding="utf-8")


def test_a_log_whose_phases_nobody_knows_says_how_to_mark_it(unlabelled, config_path) -> None:
    with pytest.raises(ConfigError, match=r"trial-0: nobody knows its phases.*--mark"):
        calibrate(config_path, PlayedDesk(), logs=unlabelled)


def test_bad_marks_stop_it_with_their_line(unlabelled, config_path, tmp_path) -> None:
    folders = tuple(shutil.copytree(log, tmp_path / log.name) for log in unlabelled)
    (folders[0] / "phases.csv").write_text("t_s,phase\n1.0,REACH\n900,ALIGN\n")
    with pytest.raises(ConfigError, match=r"phases\.csv: line 3: 900 s is outside the log"):
        calibrate(config_path, PlayedDesk(), logs=folders)


def test_a_log_without_an_arm_is_refused_with_its_name(logs, config_path, tmp_path) -> None:
    ticks, scene = session(walk(PICK))
    for tick in ticks:
        object.__setattr__(tick, "arm", None)
    blind = record(tmp_path / "blind", ticks, scene)
    with pytest.raises(LogError, match="blind: has no state of the arm"):
        calibrate(config_path, PlayedDesk(), logs=(*logs[:2], blind))


@pytest.mark.parametrize(
    ("options", "reason"),
    [
        ({}, "say where the trials come from"),
        ({"sim": True, "logs": (Path("a"),)}, "say where the trials come from"),
        ({"sim": True, "mark": True}, "--mark is for recorded logs"),
        ({"logs": (Path("a"),) * 3, "trials": 5}, "--trials and --held-out are for --sim"),
        ({"logs": (Path("a"), Path("b"))}, "2 trials are too few"),
        ({"sim": True, "trials": 2}, "2 trials are too few"),
        ({"logs": (Path("a"), Path("b"), Path("a"))}, "a: is given twice"),
        ({"logs": (Path("a"), Path("b"), Path("c"))}, "a: is no session folder"),
        ({"sim": True, "seed": -1}, "cannot be below 0"),
        ({"sim": True, "picture": Path("nowhere/a.png")}, "there is no folder nowhere"),
        ({"sim": True, "goal_height_mm": 0.0}, "must be more than 0"),
    ],
)
def test_wrong_use_is_refused_before_anything_is_made(config_path, options, reason) -> None:
    with pytest.raises(ConfigError, match=reason):
        calibrate(config_path, PlayedDesk(), **options)


def test_the_command_line_takes_logs_and_tells_by_its_exit_code(logs, config_path, capsys) -> None:
    arguments = ["calibrate", "phases", "--config", str(config_path)]
    sources = [part for log in logs for part in ("--from", str(log))]
    assert cli._main([*arguments, *sources, "--yes"]) == 0
    assert "frame-wise accuracy" in capsys.readouterr().out
    assert load_config(config_path).calibrated_by
    assert cli._main([*arguments, *sources[:2]]) == 2
    assert "too few" in capsys.readouterr().err


# --- trials in virtual time ---------------------------------------------------------------------


def test_the_same_seed_gives_the_same_trial_and_another_seed_another() -> None:
    def beginning(seed: int) -> np.ndarray:
        trial = VirtualTrial(load_config(), seed)
        for _ in islice(trial.perform(), 100):
            pass
        return np.array([tick.arm.tcp.position for tick in trial.performed().ticks if tick.arm])

    first = beginning(3)
    assert (beginning(3) == first).all()
    assert not np.array_equal(beginning(4), first)


def test_simulated_trials_become_thresholds_that_beat_the_defaults_on_trials_not_seen(
    config_path,
) -> None:
    desk = PlayedDesk()
    assert calibrate(config_path, desk, sim=True, trials=4, held_out=1, yes=True) == 0
    folder = config_path.parent / "calibration" / "rig"
    written = yaml.safe_load((folder / f"phases-{STAMP}.yaml").read_text(encoding="utf-8"))
    figures = written["calibration"]["quality"]
    assert figures["trials"] == 4
    assert figures["accuracy_leave_one_trial_out"] > figures["accuracy_defaults"]
    assert figures["accuracy_held_out"] > figures["accuracy_held_out_defaults"]
    assert load_config(config_path).policy.phases != PhasesConfig()


def test_algorithm_1_over_a_recorded_trial_is_what_the_control_loop_said() -> None:
    config = load_config()
    trial = VirtualTrial(config, 5)
    for _ in islice(trial.perform(), 240):
        pass
    ticks = trial.performed().ticks
    motion = motion_of("seed 5", ticks, ticks[0].started_ns, config.policy.phases.smoothing_ms)
    said = [CODE[tick.phase] for tick in ticks]
    assert infer(motion, config.policy.phases).tolist() == said
    assert len(set(said)) > 1
    assert PhaseParameters.of(config.policy.phases) == PhaseParameters.of(PhasesConfig())
