"""The steps `lens` and `mount` on the simulated rig, against the truth, up to the prediction."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from calibration.cameras import measuring
from calibration.cameras.bench import Task
from calibration.cameras.board import Board
from calibration.cameras.measuring import Findings
from calibration.cameras.simulated import SimulatedBench
from calibration.cameras.wizard import CameraWizard
from calibration.options import CameraOptions
from hw.arms import arm_kind
from tams_app import cli
from tams_app.config import Config, LensConfig, MountConfig, load_config
from tams_app.console import doctor
from tams_app.errors import SetupError, TamsError
from tams_app.prediction.plane_warp import RayMap, border_rays, mounted, plane_change
from tams_app.records import Lens, Pose
from tams_app.rotation import Rotation
from tams_app.session.predicting import predicted_cameras
from tams_app.session.viewing import scene_of
from tests.calibration.lab import in_force, write_lab
from tests.scripted_ui import ScriptedUI

pytestmark = pytest.mark.untimed

SEED = 3
BENT = {"eih": (-0.25, 0.06, 0.001, -0.001, 0.0), "gs": (0.08, 0.02, 0.0, 0.0, 0.0)}
DISTANCE_M = {"eih": 0.25, "gt": 0.87, "gs": 0.88}  # to where one works
GRID = np.stack(np.meshgrid(np.linspace(20, 619, 12), np.linspace(20, 459, 9)), -1).reshape(-1, 2)


@dataclass(frozen=True)
class Calibrated:
    """A run of the wizard, and what it should have found."""

    path: Path
    config: Config
    true: dict[str, Lens]
    said: list[str]

    @property
    def quality(self):
        return in_force(self.path)[1]["calibration"]["quality"]


@pytest.fixture(scope="module")
def calibrated(tmp_path_factory) -> Calibrated:
    path = write_lab(tmp_path_factory.mktemp("lab"))
    ui = ScriptedUI()
    bench = SimulatedBench(load_config(path), SEED, BENT)
    # Drawing what is behind the board for each pose of the arm would take most of the time.
    bench._rendered = lambda view, _joints: bench._scenes[view]
    options = CameraOptions(config=path, seed=SEED, sim=True, yes=True, only="which,lens,mount")
    assert CameraWizard(ui, options, bench).run() == 0
    return Calibrated(path, load_config(path), dict(bench.lenses), ui.said)


def test_each_lens_is_found_with_its_distortion(calibrated):
    for view, true in calibrated.true.items():
        found = calibrated.config.cameras[view].lens
        assert found is not None
        assert found.fx == pytest.approx(true.fx, rel=0.005)
        assert found.fy == pytest.approx(true.fy, rel=0.005)
        assert any(found.distortion) == true.is_distorted
        assert found.error_px < 0.2
        assert (found.width, found.height) == (640, 480)


def test_each_mount_is_found_and_so_is_how_far_off_a_prediction_is_in_pixels(calibrated):
    lenses = scene_of(calibrated.config).lenses
    for view, true in calibrated.true.items():
        found, told = lenses[view], calibrated.config.cameras[view].mount
        assert told is not None
        assert told.frame == ("arm" if view == "eih" else "base")
        assert found.parent == true.parent
        apart = np.linalg.norm(found.pose.position - true.pose.position)
        turned = (found.pose.rotation.inv() * true.pose.rotation).magnitude()
        assert apart < (0.001 if view == "eih" else 0.004)
        assert np.degrees(turned) < 0.3
        rays = np.insert(true.slopes(GRID), 2, 1.0, axis=1) * DISTANCE_M[view]
        off = found.projected(true.pose.position + true.pose.rotation.apply(rays)) - GRID
        assert np.sqrt((off**2).sum(axis=1).mean()) < 0.5
        assert told.error_px < 0.5


def test_a_view_predicted_through_the_lens_found_is_the_one_predicted_through_the_true_lens(
    calibrated,
):
    found, true = scene_of(calibrated.config).lenses["eih"], calibrated.true["eih"]
    then = Pose(np.array([0.30, 0.0, 0.25]), Rotation.from_rotvec((np.pi, 0.0, 0.0)))
    now = Pose(np.array([0.32, -0.02, 0.23]), Rotation.from_rotvec((3.0, 0.1, 0.15)))
    places = []
    for lens in (found, true):
        change = plane_change(border_rays(lens), mounted(then, lens.pose), mounted(now, lens.pose))
        assert change is not None
        places.append(RayMap(lens).places(change))
    inside = ((places[1] > 0) & (places[1] < (639, 479))).all(axis=-1)
    assert inside.mean() > 0.5
    off = np.linalg.norm(places[0] - places[1], axis=-1)[inside]
    assert off.max() < 0.5


def test_session_and_doctor_use_what_was_found(calibrated):
    config = load_config(calibrated.path, {"view.predict": "all"})
    cameras = predicted_cameras(config)
    assert {view: camera.on_arm for view, camera in cameras.items()} == {
        "eih": True, "gt": False, "gs": False,
    }  # fmt: skip
    assert cameras["eih"].lens.distortion == calibrated.config.cameras["eih"].lens.distortion
    for finding in doctor.predictive_display(config):
        assert finding.ok
        assert finding.detail.startswith("lens within 0.")


def test_errors_in_pixels_are_shown_kept_in_the_file_and_listed_with_what_is_in_force(calibrated):
    text = "\n".join(calibrated.said)
    assert text.count("where it was not fitted to it predicts the corners within") == 3
    shown = ["calibrate", "show", "--config", str(calibrated.path)]
    listed = CliRunner().invoke(cli.app, shown).output
    for view, kept in calibrated.quality.items():
        assert f"{view.upper()}: focal length" in text
        assert 0.0 < kept["lens_error_px"] < 0.2
        assert 0.0 < kept["mount_error_px"] < 0.5
        assert kept["lens_views"] >= 12
        assert kept["mount_views"] == (16 if view == "eih" else 5)
        assert f"{view}: lens_error_px {kept['lens_error_px']}" in listed
        assert f"mount_error_px {kept['mount_error_px']}" in listed


def test_what_was_found_stays_when_other_things_of_the_same_camera_are_measured(calibrated):
    wizard = CameraWizard(ScriptedUI(), CameraOptions(config=calibrated.path, sim=True))
    view = "gt"
    before = calibrated.config.cameras[view].model_copy(update={"latency_ms": 30.0})
    cameras = calibrated.config.cameras | {view: before}
    wizard.config = calibrated.config.model_copy(update={"cameras": cameras})
    bench = wizard._bench = SimulatedBench(calibrated.config, SEED)
    camera, other = bench.camera_of(before), bench.camera_of(calibrated.config.cameras["gs"])
    kept = wizard._keys(Findings(view, camera))
    assert LensConfig(**kept["lens"]) == before.lens
    assert MountConfig(**kept["mount"]) == before.mount
    assert kept["latency_ms"] == 30.0
    changed = wizard._keys(Findings(view, other))
    assert (changed["lens"], changed["mount"], "latency_ms" in changed) == (None, None, False)
    anew = Findings(view, camera)
    anew.lens = measuring.LensFit(calibrated.true[view], 0.1, 0.001, 20)
    renewed = wizard._keys(anew)
    assert LensConfig(**renewed["lens"]).fx == pytest.approx(calibrated.true[view].fx, abs=1e-3)
    assert renewed["mount"] is None  # found through the lens before


class Idle(SimulatedBench):
    """Someone who waves, and does nothing else that they are asked for."""

    def prompt(self, task: Task, view: str) -> None:
        if task in (Task.REST, Task.WAVE):
            super().prompt(task, view)

    @property
    def done(self) -> bool:
        return self._clock.now_ns() > 60e9


def run(path, only, bench=SimulatedBench):
    ui = ScriptedUI()
    options = CameraOptions(config=path, seed=SEED, sim=True, yes=True, only=only)
    return CameraWizard(ui, options, bench(load_config(path), SEED)), ui


def test_where_no_board_is_shown_nothing_is_written_and_the_reason_is_said(config_path):
    wizard, ui = run(config_path, "which,lens", Idle)
    with pytest.raises(TamsError, match="no lens and no mount was found"):
        wizard.run()
    assert "GT: no lens: the board was not seen at rest" in "\n".join(ui.said)
    assert load_config(config_path).calibrated_by == ()


def test_a_mount_needs_the_lens_of_the_camera_on_the_arm(config_path):
    wizard, ui = run(config_path, "which,mount")
    with pytest.raises(TamsError, match="no lens and no mount was found"):
        wizard.run()
    assert any(text.startswith("No mount: where the cameras are is told by the arm and the camera "
                               "on it: measure the lens of EIH") for text in ui.said)  # fmt: skip


def test_an_arm_whose_flange_is_not_known_and_one_that_is_not_heard_give_no_mount(config_path):
    config = load_config(config_path)
    bench = SimulatedBench(config, SEED)
    lens = bench.lenses["eih"]
    camera = next(name for name, truth in bench.truth.items() if truth.view == "eih")
    found = [Findings("eih", camera)]
    with pytest.raises(SetupError, match="where its flange is"):
        measuring.measure_mounts(ScriptedUI(), bench, Board(), found, {"eih": lens}, None)
    bench._person.joints = lambda _now_ns: None
    bench._seen = lambda view, _now_ns: bench._scenes[view]
    ui = ScriptedUI()
    figure = arm_kind(config.arm.model).figure()
    measuring.measure_mounts(ui, bench, Board(), found, {"eih": lens}, figure)
    assert found[0].mount is None
    assert any("no mount: 0 poses of the arm, 12 are needed" in text for text in ui.said)
    assert "the arm sends no reports" in str(ui.shown[-1])
