"""What was measured is kept, dated, and used by every command until it is taken back."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
import yaml
from typer.testing import CliRunner

from calibration.store import Calibration, CalibrationSet
from tams_app import cli
from tams_app.config import dump_config, load_config
from tams_app.errors import ConfigError, TamsError
from tams_app.report import plots
from tams_app.report.plots import new_figure
from tests.scripted_ui import CTRL_C, ScriptedUI

pytestmark = pytest.mark.untimed

NOON = datetime(2026, 11, 21, 12, 0, 0, tzinfo=UTC)
TURNED = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
OTHER = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))


@pytest.fixture
def store(config_path):
    return CalibrationSet(config_path, load_config(config_path), lambda: NOON)


@pytest.fixture
def hourly(config_path):
    """The same, with an hour from one calibration to the next."""
    hours = iter(range(100))
    return CalibrationSet(
        config_path, load_config(config_path), lambda: NOON + timedelta(hours=next(hours))
    )


def frame(rotation=TURNED):
    changes = {"hand": {"rotation": [list(row) for row in rotation]}}
    return Calibration("frame", changes, "three strokes", {"error_deg": 0.4})


def scaled(scale):
    changes = {"hand": {"translation_scale": scale}}
    return Calibration("frame", changes, "three strokes", {"error_deg": 0.4})


def test_a_file_tells_where_it_comes_from_and_how_good_it_is(store):
    first = store.write(frame())
    second = yaml.safe_load(store.write(frame()).read_text())["calibration"]
    assert second["kind"] == "frame"
    assert second["made"] == "2026-11-21T12:00:00+00:00"
    assert second["source"] == "three strokes"
    assert second["quality"] == {"error_deg": 0.4}
    assert second["replaces"] == first.name
    assert second["simulated"] is False


def test_the_older_file_stays_as_it_was_and_can_be_put_in_force_again(store, config_path):
    old = store.write(frame())
    before = old.read_bytes()
    new = store.write(frame(OTHER))
    assert new != old
    assert old.read_bytes() == before
    (store.folder / "in-force.yaml").write_text(f"frame: {old.name}\n")
    assert load_config(config_path).hand.rotation == TURNED


def test_the_command_line_counts_more_than_a_calibration(store, config_path):
    store.write(scaled(0.5))
    assert load_config(config_path).hand.translation_scale == 0.5
    config = load_config(config_path, {"hand.translation_scale": 0.25})
    assert config.hand.translation_scale == 0.25


def test_what_a_session_ran_with_stays_so_and_is_not_calibrated(store, config_path, tmp_path):
    store.write(frame())
    effective = tmp_path / "config.yaml"
    effective.write_text(dump_config(load_config(config_path)))
    store.write(frame(OTHER))
    assert load_config(effective).hand.rotation == TURNED
    with pytest.raises(ConfigError, match="is what a session ran with"):
        CalibrationSet(effective, load_config(effective))


def test_a_calibration_spoilt_by_hand_is_named_where_the_configuration_is_refused(
    store, config_path
):
    path = store.write(scaled(0.5))
    path.write_text(path.read_text().replace("0.5", "fast"))
    with pytest.raises(ConfigError, match=f"with {path.name} laid over it: hand.translation_scale"):
        load_config(config_path)
    with pytest.raises(ConfigError, match=r"^command line: hand\.translation_scale"):
        load_config(config_path, {"hand.translation_scale": "slow"})
    config_path.write_text(config_path.read_text() + "seed: -1\n")
    with pytest.raises(ConfigError, match=f"^{config_path}: seed"):
        load_config(config_path, {"hand.translation_scale": 0.5})


def test_a_calibration_cannot_change_what_bounds_the_arm(store, config_path):
    fast = Calibration("frame", {"limits": {"max_speed_mm_s": 400.0}}, "", {})
    with pytest.raises(ConfigError, match=r"limits\.max_speed_mm_s: is not for a frame"):
        store.write(fast)
    path = store.write(frame())
    path.write_text(path.read_text() + "  limits: {max_speed_mm_s: 400}\n")
    with pytest.raises(ConfigError, match=r"limits\.max_speed_mm_s: is not for a frame"):
        load_config(config_path)


def test_what_does_not_fit_the_configuration_is_not_kept_and_changes_nothing(store, config_path):
    good = store.write(frame())
    mirrored = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, -1.0))
    with pytest.raises(ConfigError, match="mirrored"):
        store.write(frame(mirrored))
    assert load_config(config_path).calibrated_by == (good.name,)
    assert len(list(store.folder.glob("frame-*.yaml"))) == 1


def test_a_missing_file_is_named_with_what_to_do(store, config_path):
    store.write(frame()).unlink()
    with pytest.raises(ConfigError, match=r"there is no frame-.*calibrate frame` again"):
        load_config(config_path)


@pytest.mark.parametrize(
    ("index", "reason"),
    [
        ("speed: a.yaml", "is not one of"),
        ("frame: ../a.yaml", "must be the name of a file"),
        ("frame: 3", "must be the name of a file"),
    ],
)
def test_a_wrong_index_is_refused_with_its_key(store, config_path, index, reason):
    store.folder.mkdir(parents=True)
    (store.folder / "in-force.yaml").write_text(index)
    with pytest.raises(ConfigError, match=f"in-force.yaml: '?{index.split(':')[0]}.*{reason}"):
        load_config(config_path)


def test_a_configuration_without_a_set_is_told_how_to_name_one(config_path):
    config_path.write_text("version: 1\ninclude: [networks.yaml, weights.yaml]\n")
    with pytest.raises(ConfigError, match="calibration: my-lab"):
        CalibrationSet(config_path, load_config(config_path))


def test_it_is_written_only_after_a_yes_and_what_it_would_replace_is_named_before(store):
    assert store.propose(ScriptedUI(["n"]), frame(), yes=False) is None
    assert store.in_force("frame") is None
    first = store.propose(ScriptedUI(["perhaps", "y"]), frame(), yes=False)
    assert first == store.in_force("frame")
    ui = ScriptedUI(["n"])
    store.propose(ui, frame(), yes=False)
    assert any(first.name in text for text in ui.said[: ui.said.index("Write it? [y/n] ")])


def test_without_a_terminal_only_yes_writes(store):
    ui = ScriptedUI()
    assert store.propose(ui, frame(), yes=False) is None
    assert any("--yes" in text for text in ui.said)
    assert store.propose(ui, frame(), yes=True) is not None


@pytest.mark.parametrize(
    ("instead", "error"),
    [(CTRL_C, KeyboardInterrupt), ("perhaps", ConfigError)],  # and then the terminal is closed
)
def test_a_question_that_is_never_answered_loses_nothing_and_changes_nothing(store, instead, error):
    old, ui = store.write(frame()), ScriptedUI([instead])
    with pytest.raises(error):
        store.propose(ui, frame(OTHER), yes=False)
    assert store.in_force("frame") == old
    (kept,) = set(store.folder.glob("frame-*.yaml")) - {old}
    assert f"Kept, but not in force: {kept}" in ui.said[-1]
    (store.folder / "in-force.yaml").write_text(f"frame: {kept.name}\n")  # as it was told to do
    assert store.in_force("frame") == kept


def test_what_goes_beside_a_calibration_is_there_before_it_counts(store, monkeypatch):
    figure, counted = new_figure(1, 1), []

    def saved(_figure, path):
        counted.append((path.suffix, store.in_force("frame")))

    monkeypatch.setattr(plots, "save_figure", saved)
    before = store.propose(ScriptedUI(), frame(), yes=True, draw=lambda: figure)
    assert counted == [(".png", None)]

    def fails(_figure, path):
        raise TamsError(f"{path.name}: cannot be written: No space left on device")

    monkeypatch.setattr(plots, "save_figure", fails)
    with pytest.raises(TamsError, match=r"frame-.*\.png"):
        store.propose(ScriptedUI(), frame(), yes=True, draw=lambda: figure)
    assert store.in_force("frame") == before


def test_ctrl_c_while_the_figure_is_drawn_keeps_the_result_out_of_force(store):
    def interrupted():
        raise KeyboardInterrupt

    ui = ScriptedUI()
    with pytest.raises(KeyboardInterrupt):
        store.propose(ui, frame(), yes=True, draw=interrupted)
    assert "Kept, but not in force" in ui.said[-1]
    (kept,) = store.folder.glob("frame-*.yaml")
    assert str(kept) in ui.said[-1]
    assert store.in_force("frame") is None


def test_half_a_file_does_not_stay(store, monkeypatch):
    monkeypatch.setattr("calibration.store._HEADER", "{kind} \ud800")  # no file can hold that
    with pytest.raises(UnicodeEncodeError):
        store.write(frame())
    assert list(store.folder.iterdir()) == []


def test_a_folder_that_cannot_be_written_is_one_sentence_and_before_anything_is_measured(store):
    store.check_before(ScriptedUI(), yes=True, simulated=True)
    store.folder.parent.write_text("in the way")
    with pytest.raises(TamsError, match="cannot be written"):
        store.write(frame())
    for ui, yes in ((ScriptedUI(), True), (ScriptedUI(["y"]), False)):
        with pytest.raises(TamsError, match="cannot be written: nothing that is measured"):
            store.check_before(ui, yes, simulated=False)
    store.check_before(ScriptedUI(), yes=False, simulated=False)  # nothing would be written


def test_what_was_simulated_is_never_put_in_force_for_real_devices(tmp_path):
    path = tmp_path / "lab.yaml"
    path.write_text("version: 1\ninclude: [lite6.yaml]\n")
    store = CalibrationSet(path, load_config(path, {"rig.enabled": True}), lambda: NOON)
    turned = Calibration("frame", frame().changes, "a simulated person", {}, simulated=True)
    with pytest.raises(ConfigError, match="has real devices"):
        store.propose(ScriptedUI(["y"]), turned, yes=True)
    with pytest.raises(ConfigError, match="has real devices"):
        store.write(turned)
    with pytest.raises(ConfigError, match="has real devices"):
        store.check_before(ScriptedUI(), yes=False, simulated=True)
    assert not store.folder.exists()
    store.write(frame())  # measured there
    assert load_config(path).hand.rotation == TURNED


def test_what_was_simulated_for_the_rig_is_refused_by_a_real_configuration_of_the_same_set(
    tmp_path,
):
    rig, lab = tmp_path / "rig.yaml", tmp_path / "lab.yaml"
    rig.write_text("version: 1\ninclude: [tams.yaml]\ncalibration: shared\n")
    lab.write_text("version: 1\ninclude: [lite6.yaml]\ncalibration: shared\n")
    store = CalibrationSet(rig, load_config(rig), lambda: NOON)
    turned = Calibration("frame", frame().changes, "a simulated person", {}, simulated=True)
    written = store.write(turned)
    assert load_config(rig).hand.rotation == TURNED
    with pytest.raises(ConfigError, match=f"{written.name}: was measured on the simulated rig"):
        load_config(lab)
    assert load_config(lab, {"rig.enabled": True}).hand.rotation == TURNED  # `run --sim`


# --- what is in force, and what was before ------------------------------------------------------


def phases(v_eps_mm_s=6.0, unfounded=""):
    return Calibration(
        "phases",
        {"policy": {"phases": {"v_eps_mm_s": v_eps_mm_s}}},
        "recorded trials: a, b",
        {"trials": 2, "accuracy_defaults": 0.8, "recall": {"REACH": 0.9}},
        unfounded=unfounded,
    )


def calibrate(command, config_path):
    """What the command line prints; the error that it would show is raised."""
    result = CliRunner().invoke(cli.app, ["calibrate", command, "--config", str(config_path)])
    if result.exception is not None:
        raise result.exception
    return result.output


def content_of(folder: Path) -> dict[str, bytes]:
    return {file.name: file.read_bytes() for file in folder.iterdir()}


def test_show_tells_of_each_kind_its_file_when_it_was_made_from_what_and_how_good_it_is(
    hourly, config_path
):
    hourly.write(scaled(0.4))
    hourly.write(scaled(0.5))
    hourly.write(phases(unfounded="no better than the defaults"))
    printed = calibrate("show", config_path)
    for part in (
        f"In force from {hourly.folder}",
        "frame: frame-20261121T130000Z.yaml",
        "made 2026-11-21T13:00:00+00:00 from three strokes",
        "replaced frame-20261121T120000Z.yaml",
        "error_deg: 0.4",
        "phases: phases-20261121T140000Z.yaml",
        "the first of its kind",
        "unfounded: no better than the defaults",
        "accuracy_defaults: 0.8",
        "in the file besides: recall",
        "weights: not calibrated",
    ):
        assert part in printed


def test_undo_goes_back_one_calibration_at_a_time_byte_for_byte(hourly, config_path):
    before = []
    index = hourly.index
    for made in (scaled(0.4), phases(), scaled(0.5)):
        before.append(index.read_bytes() if index.exists() else None)
        hourly.write(made)
        # a person's own remark does not get lost
        index.write_bytes(index.read_bytes() + b"# checked by Ada\r\n")
    files = content_of(hourly.folder)
    said = [calibrate("undo", config_path)]
    assert "frame-20261121T140000Z.yaml, which is kept; frame-20261121T120000Z.yaml" in said[0]
    assert index.read_bytes() == before[2]
    assert load_config(config_path).hand.translation_scale == 0.4
    said.append(calibrate("undo", config_path))
    assert "no phases calibration counts any more" in said[1]
    assert index.read_bytes() == before[1]
    calibrate("undo", config_path)
    assert not index.exists()
    assert content_of(hourly.folder) | {index.name: b""} == files | {index.name: b""}
    with pytest.raises(TamsError, match=r"nothing to undo: no calibration in .* is in force"):
        calibrate("undo", config_path)


def test_undo_leaves_what_was_put_in_force_by_hand_since(hourly, config_path):
    older, newer = hourly.write(phases(7.0)), hourly.write(phases(8.0))
    first = hourly.write(scaled(0.4))
    hourly.write(scaled(0.5))
    hourly.index.write_text(f"phases: {older.name}\nframe: frame-20261121T150000Z.yaml\n")
    calibrate("undo", config_path)
    assert set(load_config(config_path).calibrated_by) == {older.name, first.name}
    assert newer.exists()


def test_undo_works_with_files_of_before_there_was_an_undo(hourly, config_path):
    old, new = hourly.write(scaled(0.4)), hourly.write(scaled(0.5))
    lines = new.read_text().splitlines(keepends=True)
    start = next(number for number, line in enumerate(lines) if "index_before" in line)
    end = next(number for number, line in enumerate(lines) if line.startswith("config:"))
    new.write_text("".join(lines[:start] + lines[end:]))
    calibrate("undo", config_path)
    assert load_config(config_path).calibrated_by == (old.name,)


def test_undo_to_what_does_not_fit_any_more_changes_nothing(hourly, config_path):
    old, new = hourly.write(scaled(0.4)), hourly.write(scaled(0.5))
    old.unlink()
    index = hourly.index.read_bytes()
    with pytest.raises(ConfigError, match=f"without {new.name}.*there is no {old.name}"):
        calibrate("undo", config_path)
    assert hourly.index.read_bytes() == index
    assert load_config(config_path).calibrated_by == (new.name,)


OLD_FILE = """\
calibration:
  kind: cameras
  made: '2026-11-01T12:00:00+00:00'
  tams: 0.9.0
  source: the cameras of this machine, moved and shown things by a person
  simulated: false
  quality:
    gt: {camera: Webcam, light_to_capture_ms: 31.0, clock_offset_ms: 2.0, intrinsics_rms_px: 0.2,
      intrinsics_file: intrinsics-gt-20261101T120000Z.yaml}
  replaces: null
config:
  cameras:
    gt: {source: v4l2, name: '', serial: S2, path: '', file: '', pixel_format: mjpeg,
      exposure_us: 8000, white_balance_k: 4000}
"""


def test_cameras_of_an_earlier_version_are_read_and_add_nothing(config_path):
    config_path.write_text("version: 1\ninclude: [lite6.yaml]\ncalibration: lab\n")
    folder = config_path.parent / "calibration" / "lab"
    folder.mkdir(parents=True)
    (folder / "cameras-20261101T120000Z.yaml").write_text(OLD_FILE)
    (folder / "in-force.yaml").write_text("cameras: cameras-20261101T120000Z.yaml\n")
    camera = load_config(config_path).cameras["gt"]
    assert (camera.serial, camera.exposure_us, camera.latency_ms) == ("S2", 8000, 0.0)
