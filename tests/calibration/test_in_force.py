"""`calibrate show` lists what counts, `calibrate undo` lets count again what counted before."""

from datetime import UTC, datetime, timedelta
from pathlib import Path

import pytest
from typer.testing import CliRunner

from calibration.store import Calibration, CalibrationSet
from tams_app import cli
from tams_app.config import load_config
from tams_app.errors import ConfigError, TamsError

pytestmark = pytest.mark.untimed

NOON = datetime(2026, 11, 21, 12, 0, 0, tzinfo=UTC)


@pytest.fixture
def store(config_path):
    hours = iter(range(100))
    return CalibrationSet.of(
        config_path, load_config(config_path), lambda: NOON + timedelta(hours=next(hours))
    )


def frame(scale):
    return Calibration(
        "frame", {"hand": {"translation_scale": scale}}, "three strokes", {"error_deg": 0.4}
    )


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
    store, config_path
):
    store.write(frame(0.4))
    store.write(frame(0.5))
    store.write(phases(unfounded="no better than the defaults"))
    said = calibrate("show", config_path)
    for part in (
        f"In force from {store.folder}",
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
        assert part in said


def test_undo_goes_back_one_calibration_at_a_time_byte_for_byte(store, config_path):
    before = []
    index = store.index
    for made in (frame(0.4), phases(), frame(0.5)):
        before.append(index.read_bytes() if index.exists() else None)
        store.write(made)
        # a person's own remark does not get lost
        index.write_bytes(index.read_bytes() + b"# checked by Ada\r\n")
    files = content_of(store.folder)
    said = [calibrate("undo", config_path)]
    assert "frame-20261121T140000Z.yaml, which is kept; frame-20261121T120000Z.yaml" in said[0]
    assert index.read_bytes() == before[2]
    assert load_config(config_path).hand.translation_scale == 0.4
    said.append(calibrate("undo", config_path))
    assert "no phases calibration counts any more" in said[1]
    assert index.read_bytes() == before[1]
    calibrate("undo", config_path)
    assert not index.exists()
    assert content_of(store.folder) | {index.name: b""} == files | {index.name: b""}
    with pytest.raises(TamsError, match=r"nothing to undo: no calibration in .* is in force"):
        calibrate("undo", config_path)


def test_undo_leaves_what_was_put_in_force_by_hand_since(store, config_path):
    older, newer = store.write(phases(7.0)), store.write(phases(8.0))
    first = store.write(frame(0.4))
    store.write(frame(0.5))
    store.index.write_text(f"phases: {older.name}\nframe: frame-20261121T150000Z.yaml\n")
    calibrate("undo", config_path)
    assert set(load_config(config_path).calibrated_by) == {older.name, first.name}
    assert newer.exists()


def test_undo_works_with_files_of_before_there_was_an_undo(store, config_path):
    old, new = store.write(frame(0.4)), store.write(frame(0.5))
    lines = new.read_text().splitlines(keepends=True)
    start = next(number for number, line in enumerate(lines) if "index_before" in line)
    end = next(number for number, line in enumerate(lines) if line.startswith("config:"))
    new.write_text("".join(lines[:start] + lines[end:]))
    calibrate("undo", config_path)
    assert load_config(config_path).calibrated_by == (old.name,)


def test_undo_to_what_does_not_fit_any_more_changes_nothing(store, config_path):
    old, new = store.write(frame(0.4)), store.write(frame(0.5))
    old.unlink()
    index = store.index.read_bytes()
    with pytest.raises(ConfigError, match=f"without {new.name}.*there is no {old.name}"):
        calibrate("undo", config_path)
    assert store.index.read_bytes() == index
    assert load_config(config_path).calibrated_by == (new.name,)
