"""What every camera keeps to: simulated, test pattern, video file, and V4L2 through v4l2src."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
import pytest

from hw.camera import Camera
from tams_app.errors import DeviceError
from tams_app.records import Frame
from tams_app.units import NS_PER_S
from tests.contract.camera_rigs import SMALL, VIEW, CameraRig, FileRig, PatternRig, SimRig, V4l2Rig
from tests.hw.v4l2.fake_cameras import CameraProcess, camera_process

PATIENCE_S = 5.0  # generous: the machine may be busy

pytestmark = [pytest.mark.waiting, pytest.mark.usefixtures("glib_complaints")]


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


def next_of(camera: Camera) -> Frame:
    frame = camera.next_frame(PATIENCE_S)
    assert frame is not None
    return frame


@pytest.mark.parametrize("rig", ["sim", "file", "v4l2"], indirect=True)
def test_a_camera_that_is_not_there_is_one_sentence_at_the_start(rig: CameraRig) -> None:
    camera = rig.absent_camera()
    with pytest.raises(DeviceError) as raised:
        camera.start()
    assert len(str(raised.value).splitlines()) == 1
    camera.close()


def test_frames_are_of_the_view_and_of_the_size_asked_for(camera: Camera) -> None:
    frame = next_of(camera)
    assert frame.view == VIEW
    assert frame.image.shape == (SMALL.height, SMALL.width, 3)
    assert frame.image.dtype == np.uint8


def test_indices_and_capture_times_only_grow(rig: CameraRig, camera: Camera) -> None:
    frames = [next_of(camera) for _ in range(12)]
    assert all(b.index > a.index for a, b in pairwise(frames))
    assert all(b.capture_ns > a.capture_ns for a, b in pairwise(frames))
    assert frames[-1].capture_ns <= rig.now_ns()


def test_indices_are_places_on_a_fixed_grid(camera: Camera) -> None:
    frames = [next_of(camera) for _ in range(12)]
    offsets = [f.index - f.capture_ns * SMALL.fps / NS_PER_S for f in frames]
    assert max(offsets) - min(offsets) <= 1.5


def test_frames_not_read_are_skipped_and_leave_a_gap(rig: CameraRig, camera: Camera) -> None:
    before = next_of(camera)
    rig.wait(0.5)
    after = next_of(camera)
    periods = (after.capture_ns - before.capture_ns) * SMALL.fps / NS_PER_S
    assert periods > 5
    assert after.index - before.index == pytest.approx(periods, abs=1.5)


def test_each_frame_is_the_callers_own(rig: CameraRig, camera: Camera) -> None:
    frame = next_of(camera)
    original = frame.image.copy()
    for _ in range(6):
        other = next_of(camera)
        assert not np.shares_memory(other.image, frame.image)
        other.image[:] = 0
    np.testing.assert_array_equal(frame.image, original)


@pytest.mark.parametrize("rig", ["sim", "v4l2"], indirect=True)
def test_a_silent_camera_gives_none_after_the_timeout(rig: CameraRig, camera: Camera) -> None:
    next_of(camera)
    rig.silence()
    while camera.next_frame(0.2) is not None:
        pass
    start_ns = rig.now_ns()
    assert camera.next_frame(0.2) is None
    assert rig.now_ns() - start_ns >= 0.2 * NS_PER_S


def test_before_the_start_and_after_the_end_there_are_no_frames(rig: CameraRig) -> None:
    camera = rig.camera()
    with pytest.raises(DeviceError, match="not started"):
        camera.next_frame(0.01)
    camera.start()
    camera.close()
    camera.close()
    with pytest.raises(DeviceError, match="not started"):
        camera.next_frame(0.01)


def test_a_closed_camera_can_be_opened_again(rig: CameraRig) -> None:
    first = rig.camera()
    first.start()
    next_of(first)
    first.close()
    second = rig.camera()
    second.start()
    next_of(second)
    second.close()
