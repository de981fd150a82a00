"""What every camera keeps to: simulated, test pattern, video file, and V4L2 through v4l2src."""

from __future__ import annotations

from collections.abc import Iterator

import pytest

from hw.camera import Camera
from tams_app.errors import DeviceError
from tams_app.units import NS_PER_S
from tests.contract.camera_rigs import CameraRig, FileRig, PatternRig, SimRig, V4l2Rig
from tests.contract.promises.camera import CAMERA_PROMISES, CameraBench
from tests.contract.promises.promise import Promise
from tests.hw.v4l2.camera_process import CameraProcess, camera_process

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


@pytest.mark.parametrize("promise", CAMERA_PROMISES, ids=lambda promise: promise.__name__)
def test_every_camera_keeps_what_is_promised(rig: CameraRig, promise: Promise[CameraBench]) -> None:
    promise(rig)


@pytest.mark.parametrize("rig", ["sim", "file", "v4l2"], indirect=True)
def test_a_camera_that_is_not_there_is_one_sentence_at_the_start(rig: CameraRig) -> None:
    camera = rig.absent_camera()
    with pytest.raises(DeviceError) as raised:
        camera.start()
    assert len(str(raised.value).splitlines()) == 1
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
