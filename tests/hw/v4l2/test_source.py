"""V4L2 cameras through the real v4l2src; the kernel's side of the device is played."""

from __future__ import annotations

import errno
from collections.abc import Callable, Iterator
from fractions import Fraction
from typing import Any

import pytest

from hw.v4l2.devices import CameraMode
from tams_app.config import CameraConfig
from tams_app.errors import DeviceError
from tams_app.records import Frame
from tams_app.runtime.clock import MonotonicClock
from tams_app.units import NS_PER_MS, NS_PER_S
from tests.hw.v4l2.camera_process import CameraProcess, NotedCamera, camera_process
from tests.hw.v4l2.fake_cameras import (
    DISABLED,
    GREYS,
    HAS_PAYLOAD,
    HEADING,
    IMAGES,
    INTEGER,
    MARKS,
    READ_ONLY,
    RECTANGLE,
    SMALL,
    WEBCAM_CONTROLS,
    FakeControl,
    Machine,
)

pytestmark = pytest.mark.waiting

TIMEOUT_S = 10.0  # generous: the machine may be busy
Open = Callable[..., NotedCamera]


@pytest.fixture(scope="module")
def process(tmp_path_factory: pytest.TempPathFactory) -> Iterator[CameraProcess]:
    with camera_process(tmp_path_factory.mktemp("machine")) as process:
        yield process


@pytest.fixture
def machine(process: CameraProcess) -> Iterator[Machine]:
    yield process.machine
    for node in list(process.machine.nodes.iterdir()):
        process.machine.unplug(int(node.name.removeprefix("video")))


@pytest.fixture
def open_camera(process: CameraProcess, machine: Machine) -> Iterator[Open]:
    cameras: list[NotedCamera] = []

    def start(**keys: Any) -> NotedCamera:
        cameras.append(process.camera(CameraConfig(**(keys or {"name": "Webcam"}))))
        cameras[-1].start()
        return cameras[-1]

    yield start
    for camera in cameras:
        camera.close()


def next_of(camera: NotedCamera) -> Frame:
    frame = camera.next_frame(TIMEOUT_S)
    assert frame is not None
    return frame


def until_noted(camera: NotedCamera, words: str) -> None:
    for _ in range(200):
        if any(words in text for _, text in camera.notes()):
            return
        camera.next_frame(0.05)
    raise AssertionError(f"no note of {words!r}: {camera.notes()}")


def frame_number(frame: Frame) -> int:
    return round((float(frame.image.mean()) - 30) / GREYS)


# --- finding ------------------------------------------------------------------------------------


def test_cameras_are_listed_with_serial_links_and_modes(
    process: CameraProcess, machine: Machine
) -> None:
    webcam = machine.plug(0, "Webcam", "S1", port=1)
    machine.plug(1, "Webcam", "S1", port=1, metadata=True)
    machine.plug(10, "Other", "", port=3, raw=True)
    machine.plug(2, "Twin", "S2", port=2)
    found = process.cameras()
    assert webcam.changes == 0
    assert [(info.name, info.serial) for info in found] == [
        ("Webcam", "S1"),
        ("Twin", "S2"),
        ("Other", ""),
    ]
    assert [info.node for info in found] == [machine.node(number) for number in (0, 2, 10)]
    assert found[1].links == tuple(
        str(machine.dev / "v4l" / link)
        for link in ("by-id/usb-S2-video-index0", "by-path/usb-0:2:1.0-video-index0")
    )
    assert found[0].modes == (CameraMode("MJPG", True, 160, 120, (Fraction(30),)),)
    assert found[2].modes == (CameraMode("YUYV", False, 160, 120, (Fraction(30),)),)


def test_ranges_of_sizes_and_rates_are_listed_as_the_driver_gives_them(
    process: CameraProcess, machine: Machine
) -> None:
    machine.plug(raw=True, rate=Fraction(60000, 1001), slowest=5, largest=(1920, 1080))
    rates = (Fraction(60000, 1001), Fraction(5))
    ranges = CameraMode("YUYV", False, 160, 120, rates, any_rate=True, largest=(1920, 1080))
    assert [info.modes for info in process.cameras()] == [(ranges,)]


@pytest.mark.parametrize(
    ("error", "sentence"),
    [
        (errno.EACCES, "which you may not open: join the group video and log in again"),
        (errno.EBUSY, "which cannot be opened: Device or resource busy"),
    ],
)
def test_a_camera_that_cannot_be_opened_is_listed_with_the_reason(
    process: CameraProcess, machine: Machine, error: int, sentence: str
) -> None:
    machine.plug().open_error = error
    (info,) = process.cameras()
    assert str(info) == f"'Webcam', serial S1 at {machine.node(0)}, {sentence}"


def test_a_camera_in_use_is_one_sentence_at_the_start(machine: Machine, open_camera: Open) -> None:
    machine.plug()
    open_camera()
    with pytest.raises(DeviceError, match=r"camera gt: Webcam.* gives no frame: .*busy"):
        open_camera()


# --- frames -----------------------------------------------------------------------------------


@pytest.mark.parametrize(("raw", "rate"), [(False, Fraction(30000, 1001)), (True, 30)])
def test_frames_come_decoded_in_either_format_and_at_the_cameras_own_rate(
    machine: Machine, open_camera: Open, raw: bool, rate: int | Fraction
) -> None:
    machine.plug(raw=raw, rate=rate)
    camera = open_camera(name="Webcam", pixel_format="raw" if raw else "mjpeg")
    frames = [next_of(camera) for _ in range(4)]
    assert all(frame.image.shape == (120, 160, 3) for frame in frames)
    if not raw:
        assert len({(frame_number(f) - f.index) % IMAGES for f in frames}) == 1


def test_a_frame_was_taken_when_the_kernel_says(machine: Machine, open_camera: Open) -> None:
    webcam = machine.plug()
    webcam.age_us = 200_000
    camera = open_camera()
    for _ in range(5):
        frame = next_of(camera)
        assert MonotonicClock().now_ns() - frame.capture_ns >= 200 * NS_PER_MS


@pytest.mark.parametrize("raw", [False, True], ids=["mjpeg", "raw"])
def test_what_the_kernel_marks_as_incomplete_is_left_out(
    machine: Machine, open_camera: Open, raw: bool
) -> None:
    webcam = machine.plug(raw=raw)
    webcam.behaviour = MARKS
    camera = open_camera(name="Webcam", pixel_format="raw" if raw else "mjpeg")
    frames = [next_of(camera) for _ in range(10)]
    assert sum(frame.damaged for frame in frames) >= 9
    assert "marks them as incomplete" in camera.notes()[0][1]


# --- controls -----------------------------------------------------------------------------------


def test_exposure_white_balance_and_controls_are_set_in_the_camera(
    machine: Machine, open_camera: Open
) -> None:
    webcam = machine.plug()
    open_camera(name="Webcam", exposure_us=8000, white_balance_k=4600, controls={"gain": 17})
    assert webcam.values() == {
        "Gain": 17,
        "Auto Exposure": 1,
        "Exposure Time, Absolute": 80,
        "Exposure, Dynamic Framerate": 0,
        "White Balance, Automatic": 0,
        "White Balance Temperature": 4600,
    }


def test_a_control_the_camera_lacks_is_named_at_the_start(
    machine: Machine, open_camera: Open
) -> None:
    cannot_be_set = (
        FakeControl(0x0098_0001, HEADING, b"User Controls"),
        FakeControl(0x0098_0914, INTEGER, b"Privacy", 0, 1, 1, 0, 0, 0, READ_ONLY),
        FakeControl(0x0098_0915, INTEGER, b"Zoom, Relative", 0, 1, 1, 0, 0, 0, DISABLED),
        FakeControl(0x009A_0925, RECTANGLE, b"Region of Interest", flags=HAS_PAYLOAD),
    )
    machine.plug(controls=(WEBCAM_CONTROLS[0], *cannot_be_set))
    with pytest.raises(DeviceError, match=r"camera gt: .*no control zoom.*its controls: gain$"):
        open_camera(name="Webcam", controls={"zoom": 3})


def test_a_control_that_does_not_stay_as_it_was_set_is_told_once(
    machine: Machine, open_camera: Open
) -> None:
    gain = FakeControl.from_buffer_copy(WEBCAM_CONTROLS[0])
    gain.stubborn = 1
    machine.plug(controls=(gain, *WEBCAM_CONTROLS[1:]))
    camera = open_camera(name="Webcam", controls={"gain": 17})
    next_of(camera)
    assert len(camera.notes()) == 1
    assert camera.notes()[0][1].endswith("keeps gain at 10 although 17 was set")


# --- no frames ------------------------------------------------------------------------------------


def test_an_unplugged_camera_is_taken_up_again_under_another_number_with_its_settings(
    machine: Machine, open_camera: Open
) -> None:
    machine.plug(0)
    camera = open_camera(name="Webcam", exposure_us=8000)
    before = next_of(camera)
    machine.unplug(0)
    until_noted(camera, "is away: no camera has name 'Webcam'")
    assert camera.next_frame(0.1) is None
    webcam = machine.plug(3)
    after = next_of(camera)
    assert webcam.values()["Exposure Time, Absolute"] == 80
    periods = (after.capture_ns - before.capture_ns) * SMALL.fps / NS_PER_S
    assert after.index - before.index == pytest.approx(periods, abs=1.6)
    assert [level for level, _ in camera.notes()] == ["warning", "warning", "info"]
