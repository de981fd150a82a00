"""What every camera keeps to: simulated, test pattern, video file, and V4L2 through v4l2src."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import closing
from itertools import pairwise

import numpy as np
import pytest

from hw.camera import Camera
from tams_app.errors import DeviceError
from tams_app.units import NS_PER_S
from tests.contract.camera_rigs import VIEW, CameraRig, FileRig, PatternRig, SimRig, V4l2Rig
from tests.hw.v4l2.camera_process import CameraProcess, camera_process

pytestmark = [pytest.mark.waiting, pytest.mark.usefixtures("glib_complaints")]

ONE_LINE = r"\A.+\Z"
FRAMES = 12
GRID = 1.5  # periods between a frame's index and its capture time


@pytest.fixture(scope="module")
def process(tmp_path_factory: pytest.TempPathFactory) -> Iterator[CameraProcess]:
    with camera_process(tmp_path_factory.mktemp("machine")) as process:
        yield process


@pytest.fixture(params=["sim", "pattern", "file", "v4l2"])
def rig(request: pytest.FixtureRequest) -> Iterator[CameraRig]:
    rig: CameraRig
    if request.param == "sim":
        rig = SimRig()
    elif request.param == "pattern":
        rig = PatternRig()
    elif request.param == "file":
        rig = FileRig(request.getfixturevalue("tmp_path"))
    else:
        rig = V4l2Rig(request.getfixturevalue("process"))
    with rig.cleaning:
        yield rig


@pytest.fixture
def camera(rig: CameraRig) -> Iterator[Camera]:
    camera = rig.camera()
    camera.start()
    yield camera
    camera.close()


def test_frames_are_of_the_view_and_of_the_size_asked_for(rig: CameraRig, camera: Camera) -> None:
    (frame,) = rig.frames(camera, 1)
    assert frame.view == VIEW
    assert frame.image.shape == (rig.video.height, rig.video.width, 3)
    assert frame.image.dtype == np.uint8


def test_indices_and_capture_times_only_grow(rig: CameraRig, camera: Camera) -> None:
    frames = rig.frames(camera, FRAMES)
    now_ns = rig.clock.now_ns()
    for before, after in pairwise(frames):
        assert after.index > before.index
        assert after.capture_ns > before.capture_ns
    assert frames[-1].capture_ns <= now_ns


def test_indices_are_places_on_a_fixed_grid(rig: CameraRig, camera: Camera) -> None:
    frames = rig.frames(camera, FRAMES)
    places = [one.index - one.capture_ns * rig.video.fps / NS_PER_S for one in frames]
    assert max(places) - min(places) <= GRID


def test_frames_not_read_are_skipped_and_leave_a_gap(rig: CameraRig, camera: Camera) -> None:
    (before,) = rig.frames(camera, 1)
    rig.clock.sleep_until_ns(rig.clock.now_ns() + NS_PER_S // 2)
    (after,) = rig.frames(camera, 1)
    periods = (after.capture_ns - before.capture_ns) * rig.video.fps / NS_PER_S
    assert periods > 5
    assert abs(after.index - before.index - periods) <= GRID


def test_each_frame_is_the_callers_own(rig: CameraRig, camera: Camera) -> None:
    (frame,) = rig.frames(camera, 1)
    original = frame.image.copy()
    for other in rig.frames(camera, 6):
        assert not np.shares_memory(other.image, frame.image)
        other.image[:] = 0
    camera.close()
    assert (frame.image == original).all()


def test_before_the_start_and_after_the_end_there_are_no_frames(rig: CameraRig) -> None:
    with closing(rig.camera()) as camera:
        with pytest.raises(DeviceError, match=ONE_LINE):
            camera.next_frame(0.01)
        camera.start()
        camera.close()
    with pytest.raises(DeviceError, match=ONE_LINE):
        camera.next_frame(0.01)


def test_a_closed_camera_can_be_opened_again(rig: CameraRig) -> None:
    for _ in range(2):
        with closing(rig.camera()) as camera:
            camera.start()
            rig.frames(camera, 1)


@pytest.mark.parametrize("rig", ["sim", "file", "v4l2"], indirect=True)
def test_a_camera_that_is_not_there_is_one_sentence_at_the_start(rig: CameraRig) -> None:
    camera = rig.absent_camera()
    with pytest.raises(DeviceError, match=ONE_LINE):
        camera.start()
    camera.close()


@pytest.mark.parametrize("rig", ["sim", "v4l2"], indirect=True)
def test_a_silent_camera_gives_none_after_the_timeout(rig: CameraRig, camera: Camera) -> None:
    rig.frames(camera, 1)
    rig.silence()
    while camera.next_frame(0.2) is not None:
        pass
    start_ns = rig.clock.now_ns()
    assert camera.next_frame(0.2) is None
    assert rig.clock.now_ns() - start_ns >= 0.2 * NS_PER_S
