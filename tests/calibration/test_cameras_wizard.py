"""The wizard on the simulated rig and on logs, from the options to the file."""

import io

import cv2
import pytest

from calibration.cameras import binding, measuring, simulated
from calibration.cameras.bench import Task
from calibration.cameras.binding import bind_views
from calibration.cameras.flashes import FEWEST_FLASHES
from calibration.cameras.measuring import Findings
from calibration.cameras.simulated import SimulatedBench
from calibration.cameras.wizard import CameraWizard
from calibration.options import CameraOptions
from tams_app.config import load_config
from tams_app.errors import ConfigError, DeviceError
from tams_app.printing import Console
from tams_app.report.plots import DPI, WIDE_IN
from tests.calibration.lab import files, in_force
from tests.scripted_ui import ScriptedUI

pytestmark = pytest.mark.untimed

SEED = 3
VIEWS = ("eih", "gt", "gs")


@pytest.fixture
def config(config_path):
    return load_config(config_path)


@pytest.fixture
def bench(config):
    return SimulatedBench(config, SEED)


@pytest.fixture(scope="module", autouse=True)
def quick():
    """The rig's scenes are rendered once, and looked at for less long."""
    scenes = simulated._scenes(load_config(), SEED)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(simulated, "_scenes", lambda *_: scenes)
        patch.setattr(measuring, "_FLASHING_S", 11.0)
        patch.setattr(binding, "_REST_S", 1.0)
        yield


def truth_of(bench, view):
    return next((name, truth) for name, truth in bench.truth.items() if truth.view == view)


def run(path, ui=None, bench=None, **options):
    ui = ui or ScriptedUI()
    options = CameraOptions(config=path, seed=SEED, **options)
    return CameraWizard(ui, options, bench).run(), ui


@pytest.mark.verify
def test_the_simulated_rig_is_calibrated_into_a_file_that_the_configuration_uses(
    config_path, bench
):
    assert run(config_path, sim=True, yes=True)[0] == 0
    config = load_config(config_path)
    for view in config.video.views:
        name, _ = truth_of(bench, view)
        assert config.cameras[view].serial == bench.binding(name)["serial"]
    file, content = in_force(config_path)
    assert content["calibration"]["quality"]["gt"] == {"camera": truth_of(bench, "gt")[0]}
    assert cv2.imread(str(file.with_suffix(".png"))).shape[1] == round(WIDE_IN * DPI)


def test_the_latency_measured_is_what_the_configuration_then_says(config_path, bench):
    assert run(config_path, sim=True, yes=True, only="which,latency")[0] == 0
    config = load_config(config_path)
    for view in VIEWS:
        true_ms = truth_of(bench, view)[1].latency_ms
        assert config.cameras[view].latency_ms == pytest.approx(true_ms, abs=6.0)
    # another calibration of the same cameras keeps it
    assert run(config_path, sim=True, yes=True, only="which")[0] == 0
    assert load_config(config_path).cameras == config.cameras
    assert len(files(config_path, "cameras")) == 2


def test_options_that_make_no_sense_are_one_sentence(config_path):
    for options, words in (
        ({}, "give --sim, or --config"),
        ({"sim": True, "only": "which,colour"}, "'colour' is not one of which, latency"),
        ({"sim": True, "only": "which,focus"}, "focus in a session's window"),
    ):
        ui = ScriptedUI()
        with pytest.raises(ConfigError, match=words):
            run(config_path, ui, **options)
        assert ui.said == []


class WatchedBench(SimulatedBench):
    """The rig's cameras with a person before them."""

    attended = True


@pytest.mark.parametrize("how", [KeyboardInterrupt(), DeviceError("camera B is gone; plug it in")])
def test_what_was_found_until_ctrl_c_or_a_lost_camera_is_kept_but_not_in_force(
    config_path, config, monkeypatch, how
):
    def measure(ui, bench, found):
        raise how

    monkeypatch.setattr(measuring, "measure_latency", measure)
    monkeypatch.setattr(binding, "_STEP_BACK_S", 1.0)
    ui = ScriptedUI(["unused"], presses=1)
    with pytest.raises(type(how)):
        run(config_path, ui, WatchedBench(config, SEED), sim=True, only="which,latency")
    assert f"Ended early: {str(how) or 'Ctrl-C'}" in "\n".join(ui.said)
    (kept,) = files(config_path, "cameras")
    assert f"Kept, but not in force: {kept}" in ui.said[-1]
    assert load_config(config_path).calibrated_by == ()


def test_a_person_is_given_time_to_step_out_of_the_images(config, monkeypatch):
    monkeypatch.setattr(binding, "_WAITING_S", 0.5)
    monkeypatch.setattr(binding, "_STEP_BACK_S", 0.5)
    said = {}
    for each in (SimulatedBench(config, SEED), WatchedBench(config, SEED)):
        ui = ScriptedUI(["n"])
        each.prompt = lambda *_: None  # no one waves
        with pytest.raises(DeviceError, match="EIH was not found out: hardly anything moved"):
            bind_views(ui, each, VIEWS)
        said[each.attended] = any("Step out of all images within" in text for text in ui.said)
    assert said == {False: False, True: True}


def test_a_cameras_name_is_shown_to_the_letter():
    console = Console(file=io.StringIO(), width=100)
    console.print(binding._bars({"HD Cam [C920]": 0.1}, {}))
    assert "HD Cam [C920]" in console.file.getvalue()


def test_without_the_step_that_binds_them_the_cameras_must_be_bound(config_path):
    with pytest.raises(ConfigError, match="add which to --only"):
        run(config_path, sim=True, only="latency")


def test_a_camera_that_does_not_see_the_flashes_is_told_and_left_out(bench, monkeypatch):
    found = [Findings(view, truth_of(bench, view)[0]) for view in ("gt", "gs")]
    asked = bench.prompt

    def prompt(task, view):
        asked(task, "gt" if task is Task.SHOW_SCREEN else view)  # only GT is pointed at it

    monkeypatch.setattr(bench, "prompt", prompt)
    ui = ScriptedUI()
    measuring.measure_latency(ui, bench, found)
    assert found[0].latency.flashes >= FEWEST_FLASHES
    assert found[1].latency is None
    assert any(text.startswith("GS: no latency: 0 flashes were seen") for text in ui.said)
