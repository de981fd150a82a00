"""The wizard on the simulated rig and on logs, from the options to the file."""

import io

import cv2
import pytest
import yaml
from rich.console import Console

from calibration.cameras import image_step, latency_step, which_step, wizard
from calibration.cameras.bench import Task
from calibration.cameras.board import Board
from calibration.cameras.findings import Findings
from calibration.cameras.intrinsics_step import measure_intrinsics
from calibration.cameras.latency_step import measure_latency, measure_offsets_by_light
from calibration.cameras.picture import draw_findings
from calibration.cameras.simulated_bench import SimulatedBench
from calibration.cameras.wizard import Options, run_cameras
from calibration.desk import PlayedDesk
from tams_app.config import load_config
from tams_app.errors import ConfigError, DeviceError, TamsError
from tams_app.runtime.clock import MonotonicClock

pytestmark = pytest.mark.untimed

SEED = 3
RIG = "version: 1\ninclude: [networks.yaml, weights.yaml]\ncalibration: rig\n"
LAB = (
    RIG
    + "rig: {enabled: false}\ncameras:\n"
    + "".join(f"  {view}: {{source: v4l2, serial: {view}-1}}\n" for view in ("eih", "gt", "gs"))
)


@pytest.fixture
def rig(tmp_path):
    path = tmp_path / "rig.yaml"
    path.write_text(RIG)
    return path


@pytest.fixture
def lab(tmp_path):
    path = tmp_path / "lab.yaml"
    path.write_text(LAB)
    return path


@pytest.fixture
def short(monkeypatch):
    monkeypatch.setattr(image_step, "_LOOK_S", 3.0)


@pytest.fixture(scope="module")
def config(tmp_path_factory):
    path = tmp_path_factory.mktemp("config") / "rig.yaml"
    path.write_text(RIG)
    return load_config(path)


@pytest.fixture
def bench(config):
    return SimulatedBench(config, SEED, MonotonicClock(), Board())


def truth_of(bench, view):
    return next((name, truth) for name, truth in bench.truth.items() if truth.view == view)


@pytest.mark.timeout(400)
def test_the_simulated_rig_is_calibrated_into_a_file_that_the_configuration_uses(
    rig, bench, short, tmp_path
):
    image, desk = tmp_path / "found.png", PlayedDesk()
    options = Options(sim=True, seed=SEED, yes=True, image=image)
    assert run_cameras(desk, rig, options) == 0
    config = load_config(rig)
    for view in config.video.views:
        name, _ = truth_of(bench, view)
        assert config.cameras[view].serial == bench.binding(name)["serial"]
    (written,) = (tmp_path / "calibration/rig").glob("cameras-*.yaml")
    assert config.calibrated_by == (written.name,)
    kept = yaml.safe_load(written.read_text())["calibration"]["quality"]["gt"]
    assert kept["rate_hz"] == pytest.approx(30, rel=2e-3)
    assert kept["edge_blur_px"] < 1.0
    assert cv2.imread(str(image)).shape[1] == 960


@pytest.mark.timeout(400)
def test_unattended_and_without_yes_nothing_is_written(rig, short, tmp_path):
    assert run_cameras(PlayedDesk(), rig, Options(sim=True, only="which")) == 1
    assert not (tmp_path / "calibration").exists()


@pytest.mark.timeout(400)
def test_the_rigs_cameras_are_refused_at_once_for_a_laboratory(lab, tmp_path):
    desk = PlayedDesk()
    with pytest.raises(ConfigError, match="has real devices"):
        run_cameras(desk, lab, Options(sim=True, only="which", yes=True))
    assert desk.said == []
    assert not (tmp_path / "calibration").exists()


def test_options_that_make_no_sense_are_one_sentence(rig, lab, tmp_path):
    for path, options, words in (
        (rig, Options(), "give --sim, or --config"),
        (rig, Options(sim=True, logs=(tmp_path,)), "exclude each other"),
        (rig, Options(sim=True, only="which,colour"), "'colour' is none of which, focus"),
        (rig, Options(sim=True, image=tmp_path / "found.gif"), r"drawn to \.png or \.jpg"),
        (rig, Options(sim=True, image=tmp_path / "no/found.png"), "there is no folder"),
        (rig, Options(logs=(tmp_path, tmp_path), image=tmp_path / "a.png"), "drawn over it"),
        (rig, Options(sim=True, square_mm=float("nan")), "must be a length"),
    ):
        desk = PlayedDesk()
        with pytest.raises(ConfigError, match=words):
            run_cameras(desk, path, options)
        assert desk.said == []


def test_a_folder_that_cannot_be_written_is_told_before_the_first_prompt(rig, tmp_path):
    (tmp_path / "calibration").write_text("in the way")
    desk = PlayedDesk()
    with pytest.raises(TamsError, match="cannot be written"):
        run_cameras(desk, rig, Options(sim=True, yes=True))
    assert desk.said == []


class WatchedBench(SimulatedBench):
    """The rig's cameras with a person before them."""

    attended = True


@pytest.mark.parametrize(
    ("how", "answer", "count"),
    [(KeyboardInterrupt(), "y", 1), (DeviceError("camera B is gone; plug it in"), "n", 0)],
)
def test_what_was_found_until_ctrl_c_or_a_lost_camera_can_still_be_written(
    rig, tmp_path, monkeypatch, how, answer, count
):
    def look(desk, bench, found, want):
        if found.view != "eih":
            raise how

    monkeypatch.setattr(image_step, "look", look)
    desk = PlayedDesk([answer], presses=1)
    with pytest.raises(type(how)):
        run_cameras(
            desk,
            rig,
            Options(sim=True, seed=SEED, only="which,rate", yes=True),
            lambda config, options, clock, board: WatchedBench(config, SEED, clock, board),
        )
    assert f"Ended early: {str(how) or 'Ctrl-C'}" in "\n".join(desk.said)
    assert len(list(tmp_path.glob("calibration/rig/cameras-*.yaml"))) == count


def test_a_person_is_given_time_to_step_out_of_the_images(config, bench, monkeypatch):
    monkeypatch.setattr(which_step, "_PATIENCE_S", 2.0)
    monkeypatch.setattr(which_step, "_STEP_BACK_S", 1.0)
    watched = WatchedBench(config, SEED, MonotonicClock(), Board())
    said = {}
    for each in (bench, watched):
        desk = PlayedDesk(["n"])
        each.prompt = lambda *_: None  # nobody waves
        with pytest.raises(DeviceError):
            wizard.bind_views(desk, each, ("eih", "gt", "gs"))
        said[each.attended] = any("Step out of all images within" in text for text in desk.said)
    assert said == {False: False, True: True}


def test_a_cameras_name_is_shown_to_the_letter():
    console = Console(file=io.StringIO(), width=100)
    console.print(which_step._bars({"HD Cam [C920]": 0.1}, {}))
    assert "HD Cam [C920]" in console.file.getvalue()


def test_a_image_of_a_kind_that_cannot_be_drawn_is_one_sentence(tmp_path):
    with pytest.raises(ConfigError, match=r"drawn to \.png or \.jpg"):
        draw_findings([Findings("gt", "camera A")], tmp_path / "found.gif")


def test_without_the_step_that_binds_them_the_cameras_must_be_bound(rig):
    with pytest.raises(ConfigError, match="add which to --only"):
        run_cameras(PlayedDesk(), rig, Options(sim=True, only="focus"))


def test_the_lights_way_to_the_capture_is_found_within_half_a_refresh(bench, config, monkeypatch):
    monkeypatch.setattr(latency_step, "stream_delays_ms", lambda *_: [30.0] * 40)
    found = [Findings(view, truth_of(bench, view)[0]) for view in ("gt", "gs")]
    for each in found:
        focused(bench, each.view)
    measure_latency(PlayedDesk(), bench, found, config, MonotonicClock())
    for each in found:
        true_ms = truth_of(bench, each.view)[1].latency_ms
        assert abs(each.to_capture.median_ms - true_ms) < 1000 / 60 / 2 + 1.0
        assert each.in_all.median_ms == pytest.approx(each.to_capture.median_ms + 30, abs=0.5)
    true_ms = truth_of(bench, "gs")[1].latency_ms - truth_of(bench, "gt")[1].latency_ms
    assert abs(found[1].offset.ms - true_ms) < 3 * found[1].offset.error_ms


def test_the_clocks_offsets_are_found_by_a_light_that_is_switched(bench):
    found = [Findings(view, truth_of(bench, view)[0]) for view in ("eih", "gt", "gs")]
    measure_offsets_by_light(PlayedDesk(), bench, found)
    reference = truth_of(bench, "eih")[1].latency_ms
    for each in found[1:]:
        true_ms = truth_of(bench, each.view)[1].latency_ms - reference
        assert abs(each.offset.ms - true_ms) < 3 * each.offset.error_ms


@pytest.mark.timeout(400)
def test_a_lens_is_found_by_showing_the_board_until_it_suffices(bench):
    focused(bench, "gt")
    name, truth = truth_of(bench, "gt")
    found, desk = Findings("gt", name), PlayedDesk()
    measure_intrinsics(desk, bench, found, Board())
    assert found.intrinsics is not None, desk.said
    assert found.intrinsics.values["fx"] == pytest.approx(truth.lens.matrix[0, 0], rel=0.01)
    assert found.intrinsics.rms_px < 0.5


def test_the_bar_leads_the_ring_to_where_it_is_sharpest(bench):
    desk, found = PlayedDesk(), Findings("gt", truth_of(bench, "gt")[0])
    image_step.focus(desk, bench, found)
    bars = [str(shown) for shown in desk.shown]
    assert bars[-1].count("█") >= 38
    assert min(bar.count("█") for bar in bars[len(bars) // 2 :]) < 30


def test_a_person_who_does_not_wave_is_told_and_asked_again(bench, monkeypatch):
    desk = PlayedDesk()
    monkeypatch.setattr(bench, "prompt", lambda *_: None)
    monkeypatch.setattr("calibration.cameras.which_step._PATIENCE_S", 2.0)
    with pytest.raises(DeviceError, match="EIH was not found out: hardly anything moved"):
        wizard.bind_views(desk, bench, ("eih", "gt", "gs"))


def focused(bench, view):
    """Somebody has turned the ring of `view`."""
    bench.prompt(Task.FOCUS, view)
    for _ in bench.shots([truth_of(bench, view)[0]], 9.0, every=30):
        pass
    bench.prompt(Task.REST, "")
