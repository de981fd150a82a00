"""Which camera is meant, and whether it can do what is asked: on recorded device properties."""

from __future__ import annotations

import os
from dataclasses import replace
from fractions import Fraction
from pathlib import Path

import pytest

from hw.v4l2.devices import CameraInfo, CameraMode, choose_camera, choose_mode
from tams_app.errors import DeviceError

pytestmark = pytest.mark.untimed


def modes(*rates: int, pixel_format: str = "MJPG") -> tuple[CameraMode, ...]:
    fractions = tuple(map(Fraction, rates))
    return (CameraMode(pixel_format, pixel_format == "MJPG", 640, 480, fractions),)


def links(port: int, name: str) -> tuple[str, ...]:
    by_path = f"/dev/v4l/by-path/pci-0000:00:14.0-usb-0:{port}:1.0-video-index0"
    return (f"/dev/v4l/by-id/usb-{name}-video-index0", by_path)


C920_LEFT = CameraInfo("HD Pro Webcam C920", "5B7A2F", "/dev/video0", links(1, "5B7A2F"))
C920_RIGHT = CameraInfo("HD Pro Webcam C920", "91C0DE", "/dev/video2", links(2, "91C0DE"))
ARDUCAM = CameraInfo("Arducam", "", "/dev/video4", links(3, "Arducam"))
FOUND = [C920_LEFT, C920_RIGHT, ARDUCAM]


@pytest.mark.parametrize(
    ("keys", "camera"),
    [
        ({"name": "Arducam"}, ARDUCAM),
        ({"serial": "91C0DE"}, C920_RIGHT),
        ({"path": "/dev/video0"}, C920_LEFT),
        ({"path": ARDUCAM.links[0]}, ARDUCAM),
        ({"path": C920_RIGHT.links[1]}, C920_RIGHT),
        ({"name": "HD Pro Webcam C920", "serial": "5B7A2F"}, C920_LEFT),
        ({"name": "Arducam", "path": "/dev/video4"}, ARDUCAM),
    ],
)
def test_a_camera_is_known_by_any_of_its_keys(keys: dict[str, str], camera: CameraInfo) -> None:
    assert choose_camera(FOUND, **keys) is camera


def test_a_link_of_the_laboratorys_own_leads_to_its_camera(tmp_path: Path) -> None:
    (tmp_path / "wrist").symlink_to(C920_RIGHT.node)
    found = [replace(info, node=os.path.realpath(info.node)) for info in FOUND]
    assert choose_camera(found, path=str(tmp_path / "wrist")) is found[1]


@pytest.mark.parametrize(
    "keys",
    [
        {"name": "Microscope"},
        {"name": "arducam"},
        {"serial": "5B7A2F", "path": "/dev/video2"},  # numbers were swapped
        {"name": "Arducam", "serial": "91C0DE"},
        {"path": "/dev/video1"},
    ],
)
def test_every_key_must_match_and_what_is_there_is_listed(keys: dict[str, str]) -> None:
    with pytest.raises(DeviceError, match="no camera has") as raised:
        choose_camera(FOUND, **keys)
    sentence = str(raised.value)
    for value in (*keys.values(), "91C0DE at /dev/video2", "'Arducam' at /dev/video4"):
        assert value in sentence
    assert len(sentence.splitlines()) == 1


def test_twins_are_refused_with_the_paths_that_tell_them_apart() -> None:
    with pytest.raises(DeviceError, match="2 cameras have name 'HD Pro Webcam C920'") as raised:
        choose_camera(FOUND, name="HD Pro Webcam C920")
    for link in (*C920_LEFT.links, *C920_RIGHT.links):
        assert link in str(raised.value)
    assert "Arducam" not in str(raised.value)


def test_no_camera_at_all_is_said() -> None:
    with pytest.raises(DeviceError, match="found: no camera at all"):
        choose_camera([], name="Arducam")


# --- modes --------------------------------------------------------------------------------------


def camera_with(*found: CameraMode, refusal: str = "") -> CameraInfo:
    return CameraInfo("Webcam", "", "/dev/video0", (), found, refusal)


def test_the_rate_of_the_mode_is_the_cameras_own_fraction() -> None:
    ntsc = CameraMode("MJPG", True, 640, 480, (Fraction(60), Fraction(30000, 1001)))
    assert choose_mode(camera_with(ntsc), True, 640, 480, 30) == Fraction(30000, 1001)


@pytest.mark.parametrize(
    ("mjpeg", "found"),
    [
        (True, modes(30, pixel_format="YUYV")),
        (False, modes(30)),
        (True, modes(15, 60)),
        (True, (CameraMode("MJPG", True, 1280, 720, (Fraction(30),)),)),
        (True, ()),
    ],
)
def test_a_mode_that_is_not_offered_is_refused_with_those_that_are(
    mjpeg: bool, found: tuple[CameraMode, ...]
) -> None:
    kind = "MJPEG" if mjpeg else "raw frames"
    with pytest.raises(DeviceError, match=f"does not offer {kind} of 640x480 at 30/s") as raised:
        choose_mode(camera_with(*found), mjpeg, 640, 480, 30)
    for mode in found:
        assert str(mode) in str(raised.value)


def test_a_camera_one_may_not_open_says_so_when_its_mode_is_asked() -> None:
    with pytest.raises(DeviceError, match="it offers: which you may not open"):
        choose_mode(camera_with(refusal="which you may not open"), True, 640, 480, 30)


def test_raw_is_any_format_that_is_not_compressed() -> None:
    both = (*modes(30), *modes(30, pixel_format="NV12"))
    assert choose_mode(camera_with(*both), False, 640, 480, 30) == 30


def test_a_driver_that_does_not_tell_its_rates_is_asked_for_ours() -> None:
    assert choose_mode(camera_with(*modes()), True, 640, 480, 30) == 30


@pytest.mark.parametrize(
    ("width", "height", "fps", "rate"),
    [(640, 480, 30, 30), (640, 480, 90, None), (4000, 480, 30, None), (16, 16, 30, None)],
)
def test_ranges_of_sizes_and_rates_are_understood(
    width: int, height: int, fps: int, rate: int | None
) -> None:
    rates = (Fraction(60), Fraction(1))
    mode = CameraMode("YUYV", False, 32, 32, rates, any_rate=True, largest=(1920, 1080))
    assert mode.rate_for(width, height, fps) == rate
    assert str(mode) == "YUYV 32x32 to 1920x1080 at 60 to 1"
