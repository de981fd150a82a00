"""The wizard on V4L2 cameras, played below v4l2src, from the wave to the session that uses them."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from fractions import Fraction

import cv2
import numpy as np
import pytest

from calibration.cameras.bench import LiveBench, bind
from hw.v4l2.devices import CameraInfo, CameraMode
from tams_app.config import VideoConfig, load_config
from tams_app.errors import DeviceError
from tams_app.runtime.clock import MonotonicClock
from tests.calibration.camera_ui_process import ALL, STILL
from tests.hw.lite6.controller_rig import controller, until
from tests.hw.v4l2 import fake_cameras
from tests.hw.v4l2.camera_process import camera_process
from tests.hw.v4l2.fake_cameras import ROOT, Machine, build_library

pytestmark = pytest.mark.waiting

VIDEO = VideoConfig()
MODE = CameraMode("MJPG", True, 640, 480, (Fraction(30),))
RAW = CameraMode("YUYV", False, 640, 480, (Fraction(30),))


def info(number, serial="", name="Webcam", port=None, modes=(MODE,)):
    links = (f"/dev/v4l/by-path/usb-{port}",) if port else ()
    return CameraInfo(name, serial, f"/dev/video{number}", links, modes)


@pytest.mark.parametrize(
    ("found", "bound"),
    [
        (
            [info(0, "S1", port="1"), info(1, "", "Scope", port="2"), info(2, "", "Third")],
            [("S1", "", ""), ("", "/dev/v4l/by-path/usb-2", ""), ("", "", "Third")],
        ),
        (  # a serial or name that two cameras share binds neither
            [info(0, "S1", port="1"), info(1, "S1", port="2"), info(2)],
            [("", "/dev/v4l/by-path/usb-1", ""), ("", "/dev/v4l/by-path/usb-2", "")],
        ),
        ([info(2), info(3)], [("", "/dev/video2", ""), ("", "/dev/video3", "")]),
    ],
)
def test_cameras_are_bound_by_serial_else_port_else_name_if_no_other_has_it(found, bound):
    configs = [bind(each, found, VIDEO) for each in found]
    assert [(config.serial, config.path, config.name) for config in configs][: len(bound)] == bound


def test_a_camera_without_mjpeg_is_used_raw_and_one_without_either_is_refused():
    assert bind(info(0, "S1", modes=(RAW,)), [], VIDEO).pixel_format == "raw"
    with pytest.raises(DeviceError, match="does not offer raw frames"):
        bind(info(0, "S1", modes=()), [], VIDEO)


def with_and_without_a_hand(video, rounds):
    """Noisy images of something at rest, then with a hand that waves."""
    random = np.random.default_rng(3)
    scene = cv2.resize(random.integers(40, 190, (6, 8, 3)).astype(np.uint8), (160, 120))
    encoded = []
    for number in range(ALL):
        image = scene.copy()
        if number >= STILL:
            x = int(80 + 45 * np.sin(number))
            cv2.ellipse(image, (x, 60), (28, 40), 0, 0, 360, (120, 150, 205), -1)
        noisy = image + random.integers(-4, 5, image.shape)
        jpeg = cv2.imencode(".jpg", np.clip(noisy, 0, 255).astype(np.uint8))[1]
        encoded.append(jpeg.tobytes())
    longest = max(map(len, encoded))
    return [image.ljust(longest, b"\0") for image in encoded]


@pytest.mark.verify
@pytest.mark.timeout(400)
def test_waving_binds_each_view_to_its_camera_and_a_session_opens_those(tmp_path, monkeypatch):
    monkeypatch.setattr(fake_cameras, "jpegs", with_and_without_a_hand)
    library = build_library(tmp_path)
    machine = Machine(tmp_path)
    cameras = {
        0: machine.plug(0, "Webcam", "S1", port=1),
        2: machine.plug(2, "Webcam", "S2", port=2),
        4: machine.plug(4, "Webcam", "", port=3),
        6: machine.plug(6, "Spare", "S4", port=4),
    }
    machine.plug(8, "Slow", "S5", port=5, rate=15)
    for camera in cameras.values():
        camera.frame_count = STILL
    config = tmp_path / "lab.yaml"
    entries = "".join(f"  {view}: {{source: v4l2, serial: SET}}\n" for view in ("eih", "gt", "gs"))
    config.write_text(
        "version: 1\ninclude: [networks.yaml, weights.yaml]\ncalibration: lab\n"
        f"rig: {{enabled: false}}\nvideo: {{width: 160, height: 120}}\ncameras:\n{entries}"
    )
    nodes = {"eih": "video4", "gt": "video2", "gs": "video0"}
    played = {}
    for view, node in nodes.items():
        played[view] = str(tmp_path / f"played-{view}")  # opened there, it is no device
        os.link(machine.dev / node, played[view])
    environment = os.environ | {
        "LD_PRELOAD": str(library),
        "TAMS_FAKE_V4L2": str(machine.dev),
    }
    command = [sys.executable, "-m", "tests.calibration.camera_ui_process", str(machine.dev)]
    command += [str(machine.sys), str(config), json.dumps(played)]
    done = subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stdout + done.stderr
    assert "Left out" in done.stdout
    assert "does not offer" in done.stdout

    found = load_config(config)
    assert found.calibrated_by[0].startswith("cameras-")
    assert found.cameras["gt"].serial == "S2"
    assert found.cameras["gs"].serial == "S1"
    assert (found.cameras["eih"].serial, found.cameras["eih"].name) == ("", "")
    assert "by-path/usb-0:3" in found.cameras["eih"].path

    before = {number: camera.streams_started for number, camera in cameras.items()}
    with camera_process(tmp_path, machine) as process:
        for view, settings in found.cameras.items():
            camera = process.camera(settings, view)
            camera.start()
            camera.close()
            opened = int(nodes[view].removeprefix("video"))
            assert cameras[opened].streams_started == before[opened] + 1
    assert cameras[6].streams_started == before[6]


def test_the_arm_is_only_listened_to():
    with controller() as served:
        config = served.config().model_copy(update={"host": "127.0.0.1"})
        bench = LiveBench(VideoConfig(), config, MonotonicClock(), list)
        with bench.listening():
            assert until(lambda: bench.joints() is not None)
            assert bench.joints() == pytest.approx(served.model.joints)
            before = served.model.joints
        bench.close()
        assert served.model.joints == before
    bench = LiveBench(VideoConfig(), config, MonotonicClock(), list)
    with pytest.raises(DeviceError, match="sends no reports"), bench.listening():
        pass
