"""What was measured is kept, dated, and used by every command from then on."""

from datetime import UTC, datetime

import pytest
import yaml

from calibration.desk import PlayedDesk
from calibration.store import Calibration, CalibrationSet
from tams_app.config import dump_config, load_config
from tams_app.errors import ConfigError, TamsError

NOON = datetime(2026, 11, 21, 12, 0, 0, tzinfo=UTC)
TURNED = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))


@pytest.fixture
def config_path(tmp_path):
    path = tmp_path / "lab.yaml"
    path.write_text("version: 1\ninclude: [networks.yaml, weights.yaml]\ncalibration: lab\n")
    return path


@pytest.fixture
def store(config_path):
    return CalibrationSet.of(config_path, load_config(config_path), lambda: NOON)


def frame(rotation=TURNED):
    changes = {"hand": {"rotation": [list(row) for row in rotation]}}
    return Calibration("frame", changes, "three strokes", {"error_deg": 0.4})


def test_a_written_calibration_is_laid_over_the_configuration(store, config_path):
    path = store.write(frame())
    config = load_config(config_path)
    assert config.hand.rotation == TURNED
    assert config.calibrated_by == (path.name,)


def test_a_file_tells_where_it_comes_from_and_how_good_it_is(store):
    first = store.write(frame())
    second = yaml.safe_load(store.write(frame()).read_text())["calibration"]
    assert second["kind"] == "frame"
    assert second["made"] == "2026-11-21T12:00:00+00:00"
    assert second["source"] == "three strokes"
    assert second["quality"] == {"error_deg": 0.4}
    assert second["replaces"] == first.name


def test_the_older_file_stays_as_it_was_and_can_be_put_in_force_again(store, config_path):
    old = store.write(frame())
    before = old.read_bytes()
    other = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    new = store.write(frame(other))
    assert new != old
    assert old.read_bytes() == before
    (store.folder / "in-force.yaml").write_text(f"frame: {old.name}\n")
    assert load_config(config_path).hand.rotation == TURNED


def test_the_command_line_counts_more_than_a_calibration(store, config_path):
    store.write(Calibration("frame", {"hand": {"translation_scale": 0.5}}, "", {}))
    assert load_config(config_path).hand.translation_scale == 0.5
    config = load_config(config_path, {"hand.translation_scale": 0.25})
    assert config.hand.translation_scale == 0.25


def test_a_sessions_own_configuration_is_not_calibrated_anew(store, config_path, tmp_path):
    store.write(frame())
    effective = tmp_path / "config.yaml"
    effective.write_text(dump_config(load_config(config_path)))
    other = ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    store.write(frame(other))
    assert load_config(effective).hand.rotation == TURNED


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
        ("speed: a.yaml", "is none of"),
        ("frame: ../a.yaml", "must be the name of a file"),
        ("frame: 3", "must be the name of a file"),
    ],
)
def test_a_wrong_index_is_refused_with_its_key(store, config_path, index, reason):
    store.folder.mkdir(parents=True)
    (store.folder / "in-force.yaml").write_text(index)
    with pytest.raises(ConfigError, match=f"in-force.yaml: {index.split(':')[0]}.*{reason}"):
        load_config(config_path)


def test_a_configuration_without_a_set_is_told_how_to_name_one(config_path):
    config_path.write_text("version: 1\ninclude: [networks.yaml, weights.yaml]\n")
    with pytest.raises(ConfigError, match="calibration: my-lab"):
        CalibrationSet.of(config_path, load_config(config_path))


def test_it_is_written_only_after_a_yes(store):
    desk = PlayedDesk(["n"])
    assert store.propose(desk, frame(), yes=False) is None
    assert store.in_force("frame") is None
    path = store.propose(PlayedDesk(["y"]), frame(), yes=False)
    assert path == store.in_force("frame")


def test_without_anybody_to_ask_only_yes_writes(store):
    desk = PlayedDesk()
    assert store.propose(desk, frame(), yes=False) is None
    assert any("--yes" in text for text in desk.said)
    assert store.propose(desk, frame(), yes=True) is not None


def test_what_would_be_replaced_is_named_before_the_question(store):
    first = store.write(frame())
    desk = PlayedDesk(["n"])
    store.propose(desk, frame(), yes=False)
    assert any(first.name in text for text in desk.said[: desk.said.index("Write it? [y/n] ")])


def test_a_folder_that_cannot_be_made_is_one_sentence(store):
    store.folder.parent.write_text("in the way")
    with pytest.raises(TamsError, match="cannot be written"):
        store.write(frame())


def test_what_was_simulated_is_never_put_in_force_for_real_devices(tmp_path):
    path = tmp_path / "lab.yaml"
    path.write_text("version: 1\ninclude: [lite6.yaml]\n")
    store = CalibrationSet.of(path, load_config(path, {"rig.enabled": True}), lambda: NOON)
    turned = Calibration("frame", frame().changes, "a simulated person", {}, simulated=True)
    with pytest.raises(ConfigError, match="has real devices"):
        store.propose(PlayedDesk(["y"]), turned, yes=True)
    with pytest.raises(ConfigError, match="has real devices"):
        store.write(turned)
    assert not store.folder.exists()
    store.write(frame())  # measured there
    assert load_config(path).hand.rotation == TURNED
