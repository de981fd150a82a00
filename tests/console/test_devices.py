"""What `doctor --devices` prints, and what the doctor says of the hardware a file names."""

from __future__ import annotations

import io
import json
from fractions import Fraction
from pathlib import Path

import pytest

from hw.gstreamer.capture import PatternSource
from hw.openvr.devices import ControllerInfo
from hw.v4l2.devices import CameraInfo, CameraMode
from tams_app.config import CONFIG_DIRECTORY, CameraConfig, Config, load_config
from tams_app.console import devices
from tams_app.console.devices import camera_lines, controller_lines, show_devices
from tams_app.errors import DeviceError
from tams_app.printing import Console
from tests.hw.gstreamer.damaged_videos import cut, mjpeg
from tests.hw.lite6.controller_rig import controller
from tests.hw.openvr.fake_openvr import RIGHT as RIGHT_HAND
from tests.hw.openvr.fake_openvr import FakeRuntime

pytestmark = pytest.mark.untimed

MODE = CameraMode("MJPG", True, 640, 480, (Fraction(30),))
LEFT = CameraInfo("Cam", "A1", "/dev/video0", ("/dev/v4l/by-path/left",), (MODE,))
RIGHT = CameraInfo("Cam", "B2", "/dev/video2", (), (MODE,))
TRACKED = ControllerInfo("right", "vive_focus3_controller", "Focus", "S1", 0.5, True, True)
AWAY = ControllerInfo("", "knuckles", "Index", "", None, False, False)
NO_ARM = {"arm__host": "127.0.0.1", "arm__control_port": 1, "arm__report_port": 2}


def hardware(**overrides: object) -> Config:
    keys = {key.replace("__", "."): value for key, value in overrides.items()}
    return load_config(CONFIG_DIRECTORY / "lite6.yaml", keys)


def test_each_camera_is_listed_with_its_view_stable_path_and_modes() -> None:
    cameras = {"eih": CameraConfig(serial="B2"), "gt": CameraConfig(serial="nowhere")}
    lines = list(camera_lines([LEFT, RIGHT], cameras))
    assert lines == [
        "'Cam', serial A1 at /dev/video0",
        "    /dev/v4l/by-path/left",
        "    MJPG 640x480 at 30",
        "'Cam', serial B2 at /dev/video2  <- eih",
        "    MJPG 640x480 at 30",
    ]


def test_controllers_are_listed_with_hand_battery_and_tracking_and_none_is_a_sentence() -> None:
    assert list(controller_lines([TRACKED, AWAY])) == [
        "right: vive_focus3_controller S1, battery 50%, tracked",
        "no hand: knuckles, switched off",
    ]
    assert list(controller_lines([])) == ["SteamVR knows no controller: switch one on."]
    assert list(camera_lines([], {})) == ["no camera is plugged in"]


def test_the_list_is_printed_whatever_is_missing() -> None:
    output = io.StringIO()
    show_devices(hardware(**NO_ARM), console=Console(file=output, width=200))
    lines = output.getvalue().splitlines()
    titles = [line for line in lines if not line.startswith(" ")]
    assert titles == ["Arm", "Controllers", "Cameras"]
    assert lines[1].startswith("  127.0.0.1: No arm answers")


@pytest.mark.parametrize("problem", ["", "SteamVR does not run"])
def test_a_program_reads_what_was_found_and_what_is_missing(
    monkeypatch: pytest.MonkeyPatch, problem: str
) -> None:
    def controllers() -> list[ControllerInfo]:
        if problem:
            raise DeviceError(problem)
        return [TRACKED]

    monkeypatch.setattr(devices, "list_cameras", lambda: [LEFT, RIGHT])
    monkeypatch.setattr(devices, "list_controllers", controllers)
    output, views = io.StringIO(), ("eih", "gt", "gs")
    cameras = {view: {"serial": "B2" if view == "eih" else "none"} for view in views}
    settings = hardware(**NO_ARM, cameras=cameras)
    show_devices(settings, True, Console(file=output, width=80))
    tree = json.loads(output.getvalue())
    assert tree["arm"]["host"] == "127.0.0.1"
    assert "No arm answers" in tree["arm"]["problem"]
    assert tree["controllers"]["problem"] == problem
    assert [one["serial"] for one in tree["controllers"]["found"]] == ["S1"] * (not problem)
    found = [(one["serial"], one["view"]) for one in tree["cameras"]]
    assert found == [("A1", None), ("B2", "eih")]
    assert tree["cameras"][0]["modes"][0]["rates"] == [30.0]


def test_the_doctor_finds_the_arm_of_the_file_and_says_what_is_wrong_with_it() -> None:
    with controller() as rig:
        rig.model.firmware = "1.7.0"
        ports = rig.server.ports
        settings = hardware(
            arm__host="127.0.0.1", arm__control_port=ports.control, arm__report_port=ports.report
        )
        (old,) = devices.arm(settings)
        rig.model.firmware = "2.6.0"
        (new,) = devices.arm(settings)
    assert not old.ok
    assert "1.8.0" in old.fix
    assert new.ok
    assert "Lite 6" in new.detail


def test_the_doctor_names_each_view_without_a_camera() -> None:
    missing = list(devices.cameras(hardware()))
    assert [finding.what for finding in missing] == ["Camera eih", "Camera gt", "Camera gs"]
    assert all("SET-" in finding.fix for finding in missing)


def test_a_camera_whose_frames_arrive_damaged_fails_with_their_number(tmp_path: Path) -> None:
    mjpeg(tmp_path / "bad.mkv", 30, cut, range(1, 30, 2))
    bad, pattern = {"source": "file", "file": str(tmp_path / "bad.mkv")}, {"source": "pattern"}
    settings = hardware(cameras={"eih": pattern, "gt": bad, "gs": pattern})
    eih, gt, gs = devices.cameras(settings)
    assert (eih.ok, gt.ok, gs.ok) == (True, False, True)
    assert gt.detail.endswith("of its frames arrived damaged")
    assert "JPEG pictures lack their end" in gt.fix


def test_what_a_camera_did_not_take_is_told_though_it_works(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    kept = "keeps exposure at 10 although 80 was set"
    monkeypatch.setattr(PatternSource, "complaints", lambda _: [kept])
    cameras = {view: {"source": "pattern"} for view in ("eih", "gt", "gs")}
    for finding in devices.cameras(hardware(cameras=cameras)):
        assert finding.ok
        assert kept in finding.detail
        assert not finding.detail.startswith("camera")


def test_the_doctor_finds_the_controller_of_the_hand() -> None:
    runtime = FakeRuntime()
    with runtime.in_place_of_the_library():
        (there,) = devices.controller(hardware())
        runtime.devices[RIGHT_HAND].connected = False
        (away,) = devices.controller(hardware())
    assert (there.ok, there.detail) == (True, "vive_focus3_controller")
    assert (away.ok, away.detail) == (False, "none for the right hand")


def test_a_mapping_that_run_would_refuse_is_found() -> None:
    mapping = {"vive_focus3_controller": {"a": "no_such/click"}}
    with FakeRuntime().in_place_of_the_library():
        (finding,) = devices.controller(hardware(controller__mapping=mapping))
    assert not finding.ok
    assert "no_such/click" in finding.fix


def test_the_simulated_rig_needs_no_devices() -> None:
    for check in (devices.arm, devices.controller, devices.cameras):
        assert list(check(load_config())) == []
